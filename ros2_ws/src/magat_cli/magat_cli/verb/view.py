# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Show a running or a recorded team in a browser."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from magat_cli.options import Options, add_join, join, own_network, port

if TYPE_CHECKING:
    from rich.console import Console

NEEDS_ROS = True


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's options."""
    from magat_viewer.address import HOST, PORT

    parser.add_argument("bag", type=Path, nargs="?", help="of the recorded team (default: join a running one)")
    parser.add_argument(
        "--host", default=HOST, help=f"name or address to listen on (default: {HOST}, this machine only)"
    )
    parser.add_argument("--port", type=port, help=f"to listen on (default: the first free one from {PORT} on)")
    parser.add_argument("--policy", help="name or folder of the recorded robots' policy (default: found by its digest)")
    parser.add_argument(
        "--at",
        default="",
        metavar="PLACE",
        help='what a recorded team\'s page shows first, such as "episode=1&tick=20&robot=robot_3&theme=dark"',
    )
    parser.add_argument(
        "--screenshot",
        type=Path,
        metavar="FILE",
        help="write a recorded team's page to a PNG file by Chromium, and end",
    )
    add_join(parser)


def main(options: Options, console: "Console") -> int:
    """Run the verb; returns the exit status."""
    if options.bag is None:
        options.without_effect("a running team (name the bag of a recorded one)", "policy", "at", "screenshot")
        join(options)
    else:
        own_network()
    from magat_viewer.serve import save_screenshot, view_bag, view_team

    if options.bag is None:
        view_team(options.namespace, options.host, options.port, console)
    else:
        options.without_effect("a recorded team", "domain", "server", "namespace")
        if options.screenshot is not None:
            options.without_effect("--screenshot", "host", "port")
            save_screenshot(options.bag, options.policy, options.at, options.screenshot, console)
        else:
            view_bag(options.bag, options.policy, options.host, options.port, options.at, console)
    return 0
