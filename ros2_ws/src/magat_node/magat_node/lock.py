# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Locks on folders, against two processes that write to the same one; free of ROS."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from magat_node.errors import MagatError


class LockedError(MagatError):
    """Another process writes to the folder."""


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Make ``folder`` if there is none, and keep other processes that lock it out during the ``with`` statement.

    The lock leaves no file, and ends with this process, however that ends.

    Raises:
        LockedError: another process has locked it.
        MagatError: it cannot be made or opened.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError as error:
        raise MagatError(f"the folder {folder} cannot be made ({error.strerror}): choose another") from error
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise LockedError(
                f"another process writes to {folder}: wait for its end, or choose another folder"
            ) from None
        yield
    finally:
        os.close(descriptor)
