# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the options of several verbs have in common: their types, their groups, and which of them were given."""

import argparse
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from magat_node.errors import MagatError

#: Beyond it, a domain's ports are among those that systems hand out by themselves.
LAST_DOMAIN = 101
#: Of options that were not given, while the command line is read.
_ABSENT = object()


class Options(argparse.Namespace):
    """The values of a verb's options, and which of them the user gave."""

    given: frozenset[str]

    def without_effect(self, because: str, *names: str) -> None:
        """Refuse options that have no effect here.

        Args:
            because: what makes them useless, e.g. ``--set``.
            names: of the options, as attributes: ``link_loss`` for ``--link-loss``.

        Raises:
            MagatError: one of them was given.
        """
        useless = [f"--{name.replace('_', '-')}" for name in names if name in self.given]
        if useless:
            verb, them = ("has", "it") if len(useless) == 1 else ("have", "them")
            raise MagatError(f"{', '.join(useless)} {verb} no effect with {because}: remove {them}")


def read_options(parser: argparse.ArgumentParser, args: Sequence[str]) -> Options:
    """Parse ``args``, and note which options are in it; errors and help end the process as argparse does."""
    defaults = vars(parser.parse_args(args, Options()))
    names = [action.dest for action in parser._actions if action.option_strings and action.dest in defaults]
    found = vars(parser.parse_args(args, Options(**dict.fromkeys(names, _ABSENT))))
    return Options(**defaults, given=frozenset(name for name in names if found[name] is not _ABSENT))


# --- Types ---


def seconds(text: str) -> float:
    """A time above 0."""
    value = float(text)
    if not value > 0.0:
        raise argparse.ArgumentTypeError(f"{text} is not a time above 0 seconds")
    return value


def domain(text: str) -> int:
    """A ROS domain."""
    value = int(text)
    if not 0 <= value <= LAST_DOMAIN:
        raise argparse.ArgumentTypeError(f"{value} is not a ROS domain: give 0 to {LAST_DOMAIN}")
    return value


def namespace(text: str) -> str:
    """The namespace of a team."""
    from magat_node.names import InvalidNameError, team_namespace

    try:
        return team_namespace(text)
    except InvalidNameError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def port(text: str) -> int:
    """A TCP port."""
    value = int(text)
    if not 0 < value < 2**16:
        raise argparse.ArgumentTypeError(f"{value} is not a TCP port: give 1 to {2**16 - 1}")
    return value


def factor(text: str) -> float:
    """A finite number above 0."""
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a rate above 0")
    return value


def bound(text: str) -> float:
    """A suboptimality bound: a finite number of at least 1."""
    value = float(text)
    if not 1.0 <= value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a bound: give 1 (optimal) or more")
    return value


def share(text: str) -> float:
    """A number from 0 to 1."""
    value = float(text)
    if not 0.0 <= value <= 1.0:
        raise argparse.ArgumentTypeError(f"{text} is not a share: give a number from 0 to 1")
    return value


def positive(text: str) -> int:
    """A whole number above 0."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{value} is not a positive number")
    return value


def team_shape(text: str) -> tuple[int, int]:
    """Processes and robots in each, such as 4x10."""
    try:
        processes, crew = (positive(part) for part in text.split("x"))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text} is not a team: give processes x robots in each, such as 4x10"
        ) from None
    return processes, crew


# --- Groups of options ---


def add_size(parser: argparse.ArgumentParser) -> None:
    """The size of drawn cases, and their seed."""
    from magat_evaluation.splits import SET_SEED

    parser.add_argument("--robots", type=positive, default=10, help="in the team (default: 10)")
    parser.add_argument("--width", type=positive, default=20, help="of the map, cells (default: 20)")
    parser.add_argument("--height", type=positive, default=20, help="of the map, cells (default: 20)")
    parser.add_argument("--density", type=share, default=0.1, help="share of obstacle cells (default: 0.1)")
    parser.add_argument(
        "--seed", type=int, default=SET_SEED, help=f"of the cases and of every random stream (default: {SET_SEED})"
    )


def size_of(options: Options) -> dict[str, Any]:
    """Width, height, robots and density, as `draw_case` takes them."""
    return {name: getattr(options, name) for name in ("width", "height", "robots", "density")}


def add_policy(parser: argparse.ArgumentParser, default: str = "MAGAT-F-128") -> None:
    """One policy."""
    parser.add_argument(
        "--policy", default=default, help=f"name of a policy in models/, or its folder (default: {default})"
    )


def add_policies(parser: argparse.ArgumentParser) -> None:
    """Several policies."""
    parser.add_argument(
        "--policy", nargs="+", help="names of policies in models/, or their folders (default: all in models/)"
    )


def policies_of(options: Options) -> dict[str, Path]:
    """The folders of the policies that `add_policies` was given.

    Raises:
        ModelError: there is no such policy.
    """
    from magat_robot.policy.models import all_policies, find_policy

    return {name: find_policy(name) for name in options.policy} if options.policy else all_policies()


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Where work is done, as `magat_evaluation.executor` takes it."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--workers", type=positive, default=1, help="processes on this machine (default: 1)")
    where.add_argument(
        "--cluster", dest="workers", metavar="ADDRESS", help="compute on the Dask cluster of this scheduler instead"
    )


def add_world(parser: argparse.ArgumentParser) -> None:
    """How the team is run, and MovingAI's files."""
    from magat_robot.policy.config import ENCODINGS
    from magat_sim.shield import SHIELDS

    parser.add_argument("--encoding", choices=ENCODINGS, default="", help="of messages (default: the policy's)")
    parser.add_argument(
        "--link-loss",
        type=share,
        default=0.0,
        metavar="SHARE",
        help="of the radio links, lost in each tick (default: 0)",
    )
    parser.add_argument(
        "--shield", choices=SHIELDS, default="idle", help="what keeps robots from colliding (default: idle)"
    )
    parser.add_argument(
        "--scen", type=Path, nargs="+", metavar="FILE", help=".scen files; each gives one case, its first robots"
    )


def add_join(parser: argparse.ArgumentParser, namespace: bool = True) -> None:
    """Where a running team is found."""
    parser.add_argument("--domain", type=domain, help="ROS domain of the team (default: the environment's)")
    parser.add_argument(
        "--server", default="", metavar="HOST", help="of the team's discovery server; needs --domain (default: none)"
    )
    if namespace:
        parser.add_argument("--namespace", help="of the team, such as /warehouse (default: that of the only team)")


def join(options: Options) -> None:
    """From now on speak where the team of `add_join` does; to be called before rclpy is imported.

    Raises:
        MagatError: a server without a domain, or a variable of the shell that ROS cannot use.
        NetworkError: no interface leads to the server.
    """
    from magat_bringup.environment import Network
    from magat_node.shell import check_shell

    if options.domain is None:
        options.without_effect("the environment's ROS domain (give --domain as well)", "server")
    else:
        os.environ.update(Network(options.domain, options.server).tool_variables)
    check_shell()


def own_network() -> None:
    """Do without the ROS variables of the shell, for verbs that start teams; to be called before rclpy is imported.

    Raises:
        ShellError: ROS cannot use one of those that still count, such as ROS_LOG_DIR.
    """
    from magat_bringup.environment import loopback
    from magat_node.shell import check_shell

    os.environ.update(loopback(0))  # until the team has a domain
    check_shell()
