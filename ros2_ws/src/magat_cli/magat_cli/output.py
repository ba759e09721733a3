# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Results on standard output."""

import json
from typing import Any

from magat_node.plain import plain


def print_json(value: Any) -> None:
    """Print one JSON value in a line; NaN, which JSON does not have, becomes null."""
    print(json.dumps(plain(value), allow_nan=False))
