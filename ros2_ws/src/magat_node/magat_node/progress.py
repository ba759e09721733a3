# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Progress bars of commands; free of ROS. It imports rich, so nodes do not import it."""

from collections.abc import Iterable, Iterator
from typing import TypeVar

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

Item = TypeVar("Item")


def progress_bars(console: Console) -> Progress:
    """Bars for use in a ``with`` statement, which removes them at its end.

    Nothing is drawn where ``console`` is no terminal: there, each bar would leave an empty line.
    """
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    return Progress(*columns, console=console, transient=True, disable=not console.is_interactive)


def tracked(items: Iterable[Item], description: str, total: int, console: Console) -> Iterator[Item]:
    """``items``, of which there are ``total``, with a bar that counts them."""
    with progress_bars(console) as progress:
        yield from progress.track(items, total=total, description=description)
