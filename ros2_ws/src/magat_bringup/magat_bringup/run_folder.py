# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The folder of one run: made for it alone, and free of the files of earlier runs."""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from magat_node.errors import MagatError
from magat_node.lock import locked

#: Where runs get folders of their own, and the link to the newest of them.
RUNS, LATEST = Path("runs"), "latest"
#: Name of the folder of a run: when it began, local time.
_STAMP = "%Y-%m-%d_%H-%M-%S"
#: What a run writes to its folder, besides bags.
RESULTS, RESULTS_SO_FAR, PICTURE, ANIMATION = "results.json", "results.jsonl", "episode.png", "episode.gif"
LOGS = "logs"


@contextmanager
def run_folder(chosen: Path | None) -> Iterator[Path]:
    """The folder of a run, which no other run uses at the same time.

    Args:
        chosen: the folder. If None, a new folder in `RUNS` that is named by the time; it is removed if it stays empty.

    Raises:
        MagatError: it cannot be made or written, or another run uses it.
    """
    folder = chosen or _new_folder(RUNS)
    try:
        with locked(folder):
            if not os.access(folder, os.W_OK | os.X_OK):
                raise MagatError(f"the output folder {folder} cannot be written: give another --output")
            yield folder
    finally:
        if chosen is None:
            with suppress(OSError):  # it is not empty
                folder.rmdir()


def begin(folder: Path, newest: bool) -> None:
    """Remove results, pictures and logs of an earlier run from ``folder``, before those of a new run are written.

    Args:
        folder: of the run.
        newest: let the link ``runs/latest`` lead to it.

    Raises:
        MagatError: the link cannot be made.
    """
    for old in (RESULTS, RESULTS_SO_FAR, PICTURE, ANIMATION):
        (folder / old).unlink(missing_ok=True)
    for log in (folder / LOGS).glob("*.log"):
        log.unlink()
    if newest:
        _point(folder.parent / LATEST, folder)


def _new_folder(runs: Path) -> Path:
    """Make a folder in ``runs`` that is named by the time; a number is added if there is one already."""
    stamp, number = time.strftime(_STAMP), 1
    while True:
        folder = runs / (stamp if number == 1 else f"{stamp}_{number}")
        try:
            folder.mkdir(parents=True)
            return folder
        except FileExistsError:
            number += 1
        except OSError as error:
            raise MagatError(f"the folder {folder} cannot be made ({error.strerror}): give an --output") from error


def _point(link: Path, folder: Path) -> None:
    """Let ``link`` lead to ``folder``, which is beside it. A folder of that name is given its time as a name."""
    if link.is_dir() and not link.is_symlink():  # of a version that wrote there
        stamp = time.strftime(_STAMP, time.localtime(link.stat().st_mtime))
        with suppress(OSError):
            link.rename(link.with_name(f"{stamp}_{LATEST}"))
    draft = link.with_name(f".{folder.name}.link")
    draft.symlink_to(folder.name)
    try:
        draft.replace(link)
    except OSError as error:
        draft.unlink()
        raise MagatError(f"{link} cannot be replaced by a link to {folder} ({error.strerror}): remove it") from error
