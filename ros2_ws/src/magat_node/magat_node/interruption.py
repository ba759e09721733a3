"""Ctrl-C and SIGTERM, remembered: an exception raised by a signal handler is lost where Python cannot pass it on."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)
_requested = False


def check() -> None:
    """Raise KeyboardInterrupt if one of the signals has come since `watch` was called."""
    if _requested:
        raise KeyboardInterrupt


def watch() -> None:
    """From now on both signals raise KeyboardInterrupt, and `check` raises it again if that went unnoticed."""
    global _requested
    _requested = False
    for number in SIGNALS:
        signal.signal(number, _raise)


@contextmanager
def deferred() -> Iterator[None]:
    """Within it the signals raise nothing by themselves and cut no callback off: call `check` between callbacks."""
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
