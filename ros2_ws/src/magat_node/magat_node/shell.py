# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Checks of the variables of a shell that ROS reads, before ROS fails on them. Free of ROS."""

import os
from collections.abc import Mapping
from pathlib import Path

from magat_node.errors import MagatError

#: Beyond it, DDS has no ports.
_LAST_DOMAIN = 232
#: In the index of installed packages: the middlewares, and the package that chooses one of them.
_MIDDLEWARES, _CHOICE = "share/ament_index/resource_index/rmw_typesupport_cpp", "rmw_implementation"


class ShellError(MagatError, RuntimeError):
    """A variable of the shell has a value that ROS cannot use; the message names both."""


def check_shell(shell: Mapping[str, str] | None = None) -> None:
    """Check the ROS variables of this process, or those in ``shell``.

    Raises:
        ShellError: ROS could not be initialised, or would wait for ever.
    """
    shell = os.environ if shell is None else shell
    _check_domain(shell.get("ROS_DOMAIN_ID", ""))
    _check_middleware(shell.get("RMW_IMPLEMENTATION", ""), shell.get("AMENT_PREFIX_PATH", ""))
    _check_log_folder(shell)
    _check_keystore(shell)


def _check_domain(text: str) -> None:
    if text and not (text.isascii() and text.isdecimal() and int(text) <= _LAST_DOMAIN):
        raise ShellError(f"ROS_DOMAIN_ID is {text!r}: give a whole number from 0 to {_LAST_DOMAIN}, or unset it")


def _check_middleware(wanted: str, prefixes: str) -> None:
    folders = [Path(prefix) / _MIDDLEWARES for prefix in prefixes.split(os.pathsep) if prefix]
    there = sorted({entry.name for folder in folders if folder.is_dir() for entry in folder.iterdir()} - {_CHOICE})
    if wanted and there and wanted not in there:
        raise ShellError(f"RMW_IMPLEMENTATION is {wanted!r}, which is not installed: choose {' or '.join(there)}")


def _check_log_folder(shell: Mapping[str, str]) -> None:
    """ROS makes this folder, and fails if it cannot."""
    home = shell.get("ROS_HOME") or str(Path(shell.get("HOME") or "~").expanduser() / ".ros")
    folder = Path(shell.get("ROS_LOG_DIR") or f"{home}/log").expanduser()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        why = "" if os.access(folder, os.W_OK | os.X_OK) else "Permission denied"
    except OSError as error:
        why = error.strerror or str(error)
    if why:
        raise ShellError(f"ROS cannot write its logs to {folder} ({why}): set ROS_LOG_DIR to a folder that it can")


def _check_keystore(shell: Mapping[str, str]) -> None:
    """A node that must not run unprotected needs keys."""
    if shell.get("ROS_SECURITY_ENABLE") != "true" or shell.get("ROS_SECURITY_STRATEGY") != "Enforce":
        return
    keystore = shell.get("ROS_SECURITY_KEYSTORE", "")
    if not keystore or not (Path(keystore) / "enclaves").is_dir():
        raise ShellError(
            f"ROS_SECURITY_ENABLE is true, but ROS_SECURITY_KEYSTORE is {keystore!r}, which is no keystore: make one "
            "by `ros2 security create_keystore`, or unset ROS_SECURITY_ENABLE"
        )
