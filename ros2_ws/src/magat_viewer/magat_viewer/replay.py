# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""``magat replay``: publishes the recorded topics for tools again, for RViz, Foxglove and the page."""

import os
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import rclpy
from rclpy.executors import Executor
from rclpy.experimental import EventsExecutor
from rclpy.publisher import Publisher
from rclpy.signals import SignalHandlerOptions
from rich.console import Console

from magat_node import interruption
from magat_node.errors import TeamError
from magat_node.progress import progress_bars
from magat_node.topics import rviz_topics, shown_topics
from magat_recording.bag import BagError, bag_span, bag_topics, read_bag
from magat_viewer.rviz.node import RvizBridge
from magat_viewer.serve import live_page

#: How long the RViz bridge and the page may take to subscribe, seconds.
PATIENCE = 10.0


def replay(bag: Path, rate: float, rviz: bool, view: bool, delay: float, console: Console) -> int:
    """Publish the topics for tools, never those that robots subscribe to, ``rate`` times as fast as recorded.

    Args:
        bag: folder or file.
        rate: of the replay, above 0.
        rviz: whether an RViz bridge draws the world; the recorded topics of an RViz bridge are not published then.
        view: whether there is a page for browsers.
        delay: seconds before the first message, in which tools can discover the topics.
        console: shows the progress.

    Returns:
        The number of published messages.

    Raises:
        BagError: the bag cannot be read, or has no World topic.
        TeamError: the RViz bridge or the page does not subscribe.
        ServerError: the page cannot be served.
        KeyboardInterrupt: interrupted.
    """
    count, first, last = bag_span(bag)
    recorded = bag_topics(bag)
    world = next((name for name, kind in recorded.items() if kind.endswith("/World")), None)
    if world is None:
        raise BagError(
            f"{bag} has no topic of the type World among its {count} messages: it is not the recording of a team"
        )
    namespace = world.removesuffix("world")
    context = rclpy.Context()
    with interruption.deferred(), ExitStack() as stack:
        rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
        stack.callback(context.try_shutdown)
        node = rclpy.create_node("replay", context=context)
        executor = EventsExecutor(context=context)
        executor.add_node(node)
        replaced = {topic.name for topic in rviz_topics()} if rviz else set()
        publishers = {}
        for topic in shown_topics():
            name = topic.name if topic.name.startswith("/") else namespace + topic.name
            if name in recorded and topic.name not in replaced | {"/rosout"}:
                publishers[name] = node.create_publisher(topic.kind, name, topic.profile)
        if rviz:
            executor.add_node(RvizBridge(context=context, namespace=namespace.rstrip("/") or "/"))
        if view:
            page = stack.enter_context(live_page(context, namespace.rstrip("/") or "/"))
            console.print(f"The page is at {page.url}", highlight=False)
        if not _spin(executor, lambda: publishers[world].get_subscription_count() >= rviz + view, PATIENCE):
            raise TeamError(f"the RViz bridge or the page did not subscribe within {PATIENCE:g} s")
        domain = os.environ.get("ROS_DOMAIN_ID", "0")
        console.print(f"In ROS domain {domain}: {', '.join(sorted(publishers))}", highlight=False)
        begin = time.monotonic() + delay
        _spin(executor, lambda: time.monotonic() >= begin, 2 * delay)
        return _publish(bag, rate, publishers, executor, console, (first, last))


def _publish(
    bag: Path,
    rate: float,
    publishers: dict[str, Publisher],
    executor: Executor,
    console: Console,
    span: tuple[int, int],
) -> int:
    first, last = span
    published = 0
    with progress_bars(console) as progress:
        task = progress.add_task("replaying, seconds", total=(last - first) / 1e9)
        began = time.monotonic()
        for message in read_bag(bag):
            if message.topic not in publishers:
                continue
            since = (message.received - first) / 1e9
            while (left := began + since / rate - time.monotonic()) > 0:
                interruption.check()
                executor.spin_once(timeout_sec=min(left, 0.1))
            publishers[message.topic].publish(message.data)
            published += 1
            progress.update(task, completed=since)
    return published


def _spin(executor: Executor, until: Callable[[], bool], timeout: float) -> bool:
    deadline = time.monotonic() + timeout
    while not until():
        interruption.check()
        if time.monotonic() > deadline:
            return False
        executor.spin_once(timeout_sec=0.1)
    return True
