# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Processes that end with their parent (Linux)."""

import ctypes

_PR_SET_PDEATHSIG = 1


def end_with_parent(signal: int) -> None:
    """From now on the kernel sends this process ``signal`` when its parent ends, however that ends.

    Call it in a forked child. A parent that has ended before the call is not noticed.
    """
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, signal)
