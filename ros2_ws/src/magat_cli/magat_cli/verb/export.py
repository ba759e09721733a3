# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Make a policy's form for onnxruntime, unless it is there; needs torch."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from magat_cli.options import Options

if TYPE_CHECKING:
    from rich.console import Console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    parser.add_argument("policy", help="name of a policy in models/, or its folder")


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    from magat_robot.policy.folder import EXPORT

    console.print(str(exported_policy(options.policy, console) / EXPORT), highlight=False)
    return 0


def exported_policy(policy: str, console: "Console") -> Path:
    """The folder of the policy, whose form for onnxruntime is made if it is missing.

    Raises:
        ModelError: there is no such policy, or it cannot be used.
    """
    from magat_robot.policy.backends import ensure_exported
    from magat_robot.policy.models import find_policy

    folder = find_policy(policy)
    with console.status(f"exporting {policy} for onnxruntime"):
        ensure_exported(folder)
    return folder
