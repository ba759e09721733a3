# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Programs that are told to end while they still import their modules."""

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def quiet_imports() -> Iterator[None]:
    """A context for the imports of a program: SIGINT and SIGTERM end it at once, and nothing is printed.

    An exception would be raised in the middle of some module, and its traceback is pages long. Nothing needs to be
    cleaned up yet.
    """
    if threading.current_thread() is not threading.main_thread():  # which is the only one that may handle signals
        yield
        return
    before = {number: signal.signal(number, _end) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _end(_: int, __: FrameType | None) -> None:
    os._exit(0)
