# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Errors that the user can fix. Free of ROS."""


class MagatError(Exception):
    """The base of all errors that the user can fix. The message says what is wrong, the value, and what to do.

    The ``magat`` command prints it in one line. Any other exception is a bug.
    """


class TeamError(MagatError, RuntimeError):
    """The team cannot continue; the message says which process failed and what it logged last."""


class UnusableMessageError(ValueError):
    """A message is well-formed, but its contents cannot be used; ``str()`` says why.

    A callback raises it, and the message is dropped, see `magat_node.intake`.
    """
