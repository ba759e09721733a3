# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Remembers SIGINT and SIGTERM, because an exception from a signal handler is lost inside callbacks from C code."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)
_requested = False


def check() -> None:
    """Raise KeyboardInterrupt if one of the signals has arrived since `watch` was called."""
    if _requested:
        raise KeyboardInterrupt


def watch() -> None:
    """Let both signals raise KeyboardInterrupt. If that exception is lost, `check` raises it again."""
    global _requested
    _requested = False
    for number in SIGNALS:
        signal.signal(number, _raise)


@contextmanager
def deferred() -> Iterator[None]:
    """A context in which signals interrupt no callback. Call `check` between callbacks to raise KeyboardInterrupt."""
    before = {number: signal.signal(number, _note) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _note(_: int, __: FrameType | None) -> None:
    global _requested
    _requested = True


def _raise(number: int, frame: FrameType | None) -> None:
    _note(number, frame)
    raise KeyboardInterrupt
