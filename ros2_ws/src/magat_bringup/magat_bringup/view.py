"""``magat view``, and the process ``viewer`` of a team: the page that shows it, live or recorded."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import rclpy
from rclpy.context import Context
from rclpy.signals import SignalHandlerOptions
from rich.console import Console

from magat_bringup import interruption
from magat_bringup.join import find_team
from magat_node.parameters import declare_value
from magat_node.run import give_way
from magat_viewer.address import HOST, ServerError
from magat_viewer.node import LiveTeam
from magat_viewer.server import PageServer

if TYPE_CHECKING:
    from magat_bringup.recorded import RecordedTeam


def view_bag(bag: Path, policy: str | None, host: str, port: int | None, at: str, console: Console) -> None:
    """Show a recorded team until interrupted.

    Args:
        bag: folder or file.
        policy: name or folder of what the robots carried; found by its digest if None.
        host: to listen on.
        port: to listen on; the first free one if None.
        at: what is shown first: the fragment of the page's address.
        console: says where the page is.

    Raises:
        BagError: it cannot be read.
        ModelError: there is no policy ``policy``.
        ServerError: the page cannot be served.
        KeyboardInterrupt: interrupted.
    """
    with PageServer(recorded_team(bag, policy, console), host, port) as page:
        _wait(page, console, at)


def save_screenshot(bag: Path, policy: str | None, at: str, file: Path, console: Console) -> None:
    """Write the page of a recorded team to the PNG file ``file``; arguments and errors otherwise as of `view_bag`.

    Raises:
        BrowserError: there is no Chromium, or the page shows nothing in it.
    """
    from magat_viewer.browser import screenshot

    with PageServer(recorded_team(bag, policy, console)) as page:
        screenshot(f"{page.url}#{at}", file)
    console.print(f"The page is in {file}", highlight=False)


def recorded_team(bag: Path, policy: str | None, console: Console) -> "RecordedTeam":
    """A recording, ready to be shown; arguments and errors as of `view_bag`."""
    # Neither these nor torch are loaded by the page of a team that runs.
    import torch

    from magat_bringup.analysis import TeamRecording
    from magat_bringup.analyze import carried_policy
    from magat_bringup.recorded import RecordedTeam

    torch.set_num_threads(1)  # what one robot computes is small: threads would only wait for each other
    with console.status(f"reading {bag}"):
        recording = TeamRecording(bag)
        carried, why = carried_policy(recording, policy)
        return RecordedTeam(recording, why if carried is None else carried, str(bag))


def view_team(namespace: str | None, host: str, port: int | None, console: Console) -> None:
    """Show the team of this environment's ROS domain until interrupted.

    Args:
        namespace: of the team; None if there is only one.
        host: to listen on.
        port: to listen on; the first free one if None.
        console: says where the page is.

    Raises:
        TeamError: there is no team, or more than one and no ``namespace``.
        ServerError: the page cannot be served.
        KeyboardInterrupt: interrupted.
    """
    give_way()
    with console.status("looking for a team"):
        found = find_team(namespace)
    context = rclpy.Context()
    with interruption.deferred():
        rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
        try:
            with live_page(context, found.namespace, host, port) as page:
                _wait(page, console)
        finally:
            context.try_shutdown()


@contextmanager
def live_page(context: Context, namespace: str, host: str = HOST, port: int | None = None) -> Iterator[PageServer]:
    """The page of the team in ``namespace``, as long as the ``with`` statement lasts.

    Raises:
        ServerError: it cannot be served.
    """
    team = LiveTeam(context, _find_policy, namespace)
    try:
        with PageServer(team, host, port) as page:
            yield page
    finally:
        team.destroy()


def _find_policy(digest: str) -> Path | None:
    from magat_bringup.models import policy_of_digest

    return policy_of_digest(digest)


def _wait(page: PageServer, console: Console, at: str = "") -> NoReturn:
    address = f"{page.url}#{at}" if at else page.url
    console.print(f"The page is at {address} until Ctrl-C", highlight=False, markup=False)
    with interruption.deferred():
        while True:
            interruption.check()
            page.wait(0.1)


def main(args: list[str] | None = None) -> int:
    """Show the team of this namespace until told to end. Returns the exit status."""
    give_way()
    interruption.watch()
    with interruption.deferred():
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        team = LiveTeam(rclpy.get_default_context(), _find_policy)
        try:
            host = declare_value(team.node, "host", HOST, "name or address to listen on")
            port = declare_value(team.node, "port", 0, "TCP port to listen on; the first free one from 8300 on if 0")
            with PageServer(team, host, port or None) as page:
                team.node.get_logger().info(f"the page is at {page.url}")
                _wait(page, Console(quiet=True))
        except KeyboardInterrupt:
            return 0
        except ServerError as error:
            team.node.get_logger().fatal(str(error))
            return 1
        finally:
            team.destroy()
            rclpy.try_shutdown()


if __name__ == "__main__":
    sys.exit(main())
