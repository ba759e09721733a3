"""``python -m magat_bringup`` is the ``magat`` command."""

import sys

from magat_bringup.cli import main

sys.exit(main())
