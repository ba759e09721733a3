# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""``magat view``: serves the page of a running or recorded team until it is interrupted."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import rclpy
from rclpy.context import Context
from rclpy.signals import SignalHandlerOptions
from rich.console import Console

from magat_node import interruption
from magat_node.run import give_way
from magat_node.teams import find_team
from magat_robot.policy.models import policy_of_digest
from magat_viewer.address import HOST
from magat_viewer.node import LiveTeam
from magat_viewer.server import PageServer

if TYPE_CHECKING:
    from magat_viewer.recorded import RecordedTeam


def view_bag(bag: Path, policy: str | None, host: str, port: int | None, at: str, console: Console) -> None:
    """Show a recorded team until interrupted.

    Args:
        bag: folder or file.
        policy: name or folder of the robots' policy; found by its digest if None.
        host: name or address to listen on.
        port: TCP port; the first free one if None.
        at: fragment of the page's address, which selects what is shown first.
        console: shows the address of the page.

    Raises:
        BagError: the bag cannot be read.
        ModelError: there is no policy ``policy``.
        ServerError: the page cannot be served.
        KeyboardInterrupt: interrupted.
    """
    with PageServer(recorded_team(bag, policy, console), host, port) as page:
        wait(page, console, at)


def save_screenshot(bag: Path, policy: str | None, at: str, file: Path, console: Console) -> None:
    """Write the page of a recorded team to the PNG file ``file``; arguments and errors as for `view_bag`.

    Raises:
        BrowserError: Chromium is not installed, or the page shows no episode.
    """
    from magat_viewer.browser import screenshot

    with PageServer(recorded_team(bag, policy, console)) as page:
        screenshot(f"{page.url}#{at}", file)
    console.print(f"The screenshot is in {file}", highlight=False)


def recorded_team(bag: Path, policy: str | None, console: Console) -> "RecordedTeam":
    """The source of a recorded team; arguments and errors as for `view_bag`."""
    # The page of a running team does not need pandas, which takes long to import.
    from magat_recording.findings import attention_policy
    from magat_recording.tables import TeamRecording
    from magat_viewer.recorded import RecordedTeam

    with console.status(f"reading {bag}"):
        recording = TeamRecording(bag)
        carried, why = attention_policy(recording, policy)
        return RecordedTeam(recording, why if carried is None else carried, str(bag))


def view_team(namespace: str | None, host: str, port: int | None, console: Console) -> None:
    """Show the team of this environment's ROS domain until interrupted.

    Args:
        namespace: of the team; None if there is only one team.
        host: name or address to listen on.
        port: TCP port; the first free one if None.
        console: shows the address of the page.

    Raises:
        TeamError: there is no team, or there are several and ``namespace`` is None.
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
                wait(page, console)
        finally:
            context.try_shutdown()


@contextmanager
def live_page(context: Context, namespace: str, host: str = HOST, port: int | None = None) -> Iterator[PageServer]:
    """The page of the running team in ``namespace``, for use in a ``with`` statement.

    Raises:
        ServerError: it cannot be served.
    """
    team = LiveTeam(context, policy_of_digest, namespace)
    try:
        with PageServer(team, host, port) as page:
            yield page
    finally:
        team.destroy()


def wait(page: PageServer, console: Console, at: str = "") -> NoReturn:
    """Show the address of ``page``, with the fragment ``at``, and wait until interrupted.

    Raises:
        KeyboardInterrupt: interrupted.
    """
    address = f"{page.url}#{at}" if at else page.url
    console.print(f"The page is at {address} (Ctrl-C ends it)", highlight=False, markup=False)
    with interruption.deferred():
        while True:
            interruption.check()
            page.wait(0.1)
