# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Values for JSON; free of ROS."""

import math
from typing import Any


def plain(value: Any) -> Any:
    """``value`` with None instead of NaN and infinities, which JSON does not have."""
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
