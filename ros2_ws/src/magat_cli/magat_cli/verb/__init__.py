# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The verbs of the ``magat`` command, a module each.

A module's docstring is the verb's help. It has ``add_arguments(parser)`` and ``main(options, console)``, which returns
the exit status; ``NEEDS_ROS = True`` if the verb speaks to a team. A module imports at its top only what is quick to
import, because ``magat --help`` imports them all; the rest is imported in ``main``.
"""
