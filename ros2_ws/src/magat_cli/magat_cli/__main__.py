# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""``python -m magat_cli`` is the ``magat`` command."""

import sys

from magat_cli.main import main

if __name__ == "__main__":
    sys.exit(main())
