# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Files that are never seen half written; free of ROS."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def write_atomically(path: Path) -> Iterator[Path]:
    """Replace the file ``path`` in one step.

    The ``with`` statement gets the path of a draft beside it to write. The draft takes the name ``path`` when the
    statement ends without an error, and is deleted otherwise. A reader, or a process that is killed at any moment,
    finds either the whole old file or the whole new one.
    """
    draft = path.with_name(f"{path.name}.draft")
    try:
        yield draft
        draft.replace(path)
    except BaseException:
        draft.unlink(missing_ok=True)
        raise
