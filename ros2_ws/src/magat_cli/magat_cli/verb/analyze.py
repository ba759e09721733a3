# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Print measures, timing, attention and deadlocks of a recorded team."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from magat_cli.options import Options

if TYPE_CHECKING:
    from rich.console import Console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    parser.add_argument("bag", type=Path)
    parser.add_argument("--policy", help="name or folder of the robots' policy (default: found by its digest)")
    parser.add_argument("--output", type=Path, metavar="FOLDER", help="for pictures and tables (default: none)")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    from rich.console import Console

    from magat_cli.output import print_json
    from magat_recording.findings import analyze
    from magat_recording.report import make_report, save, show

    findings = analyze(options.bag, options.policy, console)
    if options.output is not None:
        save(findings, options.output, console)
    if options.json:
        print_json(make_report(findings).to_json())
    else:
        show(findings, Console())
    return 0
