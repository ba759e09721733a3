# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""``magat bench-view``: frames per second of the page, and the CPU time of its server, by the size of the team.

The robots walk at random. Their worlds are published as by a simulator, and the page's server is the same process as in
a team. The browser is a headless Chromium, which draws on the CPU.
"""

import os
import socket
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
import rclpy
from rclpy.signals import SignalHandlerOptions
from rich.console import Console
from rich.table import Table

from magat_bringup.environment import loopback, own_domain
from magat_bringup.processes import TeamProcesses
from magat_bringup.team import PagePlan, TeamFile
from magat_evaluation.splits import SET_SEED
from magat_interfaces.msg import World
from magat_node.errors import TeamError
from magat_node.progress import progress_bars
from magat_node.topics import WORLD
from magat_sim.case import draw_case
from magat_sim.grid import IntArray
from magat_sim.simulator import Simulator
from magat_sim.streams import episode_streams
from magat_viewer.address import HOST, free_port
from magat_viewer.browser import chromium, until

#: Ticks of an episode, after which the next one begins.
_TICKS = 300
#: Limit for the start of the page's server, seconds.
PATIENCE = 60.0
#: Time between opening the page and measuring, seconds.
_WARM_UP = 3.0


@dataclass(frozen=True)
class Crowd:
    """A team to show."""

    robots: int
    side: int
    #: Ticks a second.
    rate: float


#: Maps with as many robots per cell as 20x20 with 10, and the paper's largest; at the highest rates of such teams here.
CROWDS = (Crowd(10, 20, 150.0), Crowd(200, 89, 30.0), Crowd(1000, 200, 10.0))


@dataclass(frozen=True)
class Smoothness:
    """Measures of a crowd."""

    #: Frames that the page drew per second.
    frames_per_second: float
    #: Time to draw a frame, milliseconds.
    p50: float
    p95: float
    #: CPU time as shares of one core: the server without and with a browser, and all processes of the browser.
    alone: float
    watched: float
    browser: float


def measure(crowd: Crowd, seconds: float) -> Smoothness:
    """Measure ``crowd`` for ``seconds`` with a browser, and for ``seconds`` without one.

    Raises:
        BrowserError: there is no Chromium, or the page shows nothing.
        TeamError: the server ended.
    """
    with own_domain() as domain, tempfile.TemporaryDirectory() as folder:
        environment = loopback(domain)
        os.environ.update(environment)
        port = free_port()
        plan = PagePlan(TeamFile.numbered(crowd.robots), Path(folder), view=port)
        with TeamProcesses(plan, Path(folder, "logs"), environment) as team, _published(crowd, domain):
            server = psutil.Process(team.pids("viewer")[0])
            _wait_for(port, team)
            with chromium() as browser:
                page = browser.new_page(viewport={"width": 1440, "height": 900})
                page.goto(f"http://{HOST}:{port}/")
                until(page, "Boolean(window.magat && magat.player.frame)")
                page.wait_for_timeout(1000 * _WARM_UP)
                others = [one for one in psutil.Process().children(recursive=True) if one != server]
                page.evaluate("magat.map.statistics = {frames: 0, milliseconds: []}")
                watched, drawing = _load([server], seconds, others)
                statistics = page.evaluate("magat.map.statistics")
            alone, _ = _load([server], seconds, [])
            team.check()
    p50, p95 = np.percentile(statistics["milliseconds"], [50, 95])
    return Smoothness(statistics["frames"] / seconds, p50, p95, alone, watched, drawing)


def _load(processes: list[psutil.Process], seconds: float, others: list[psutil.Process]) -> tuple[float, float]:
    """CPU time of both groups in the next ``seconds``, as shares of one core."""

    def spent() -> np.ndarray:
        return np.array([sum(sum(one.cpu_times()[:2]) for one in group) for group in (processes, others)])

    before, began = spent(), time.monotonic()
    time.sleep(seconds)
    share = (spent() - before) / (time.monotonic() - began)
    return float(share[0]), float(share[1])


def _wait_for(port: int, team: TeamProcesses) -> None:
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        team.check()
        with socket.socket() as probe:
            if probe.connect_ex((HOST, port)) == 0:
                return
        time.sleep(0.1)
    raise TeamError(f"the page does not listen after {PATIENCE:g} s")


@contextmanager
def _published(crowd: Crowd, domain: int) -> Iterator[None]:
    """Publish the worlds of ``crowd``, one episode after the other, within the ``with`` statement."""
    context = rclpy.Context()
    rclpy.init(args=[], context=context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
    ended = threading.Event()
    node = rclpy.create_node("simulator", context=context)
    publisher = WORLD.publisher(node)
    worlds = _worlds(crowd)

    def publish() -> None:
        episode, due = 0, time.monotonic()
        while not ended.is_set():
            episode += 1
            for world in worlds:
                world.episode = episode
                publisher.publish(world)
                due += 1 / crowd.rate
                if ended.wait(max(0.0, due - time.monotonic())):
                    return

    thread = threading.Thread(target=publish, name="worlds")
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        node.destroy_node()
        context.try_shutdown()


def _worlds(crowd: Crowd) -> list[World]:
    """The worlds of an episode in which all robots walk at random."""
    case = draw_case(SET_SEED, 0, crowd.side, crowd.side, crowd.robots)
    simulator = Simulator([case], [_TICKS], [episode_streams(SET_SEED, 0, crowd.robots)])
    rng = np.random.default_rng(SET_SEED)
    none = np.zeros(crowd.robots, dtype=np.int64)
    worlds: list[World] = []

    def note(actions: IntArray, moved: IntArray) -> None:
        world = World(tick=simulator.tick, robots=TeamFile.numbered(crowd.robots).robots)
        world.width = world.height = crowd.side
        world.obstacles = case.obstacles.astype(np.uint8).ravel().tolist() if simulator.tick == 0 else []
        world.x, world.y = simulator.position.T.tolist()
        world.goal_x, world.goal_y = case.goals.T.tolist()
        world.action, world.moved = actions.tolist(), moved.tolist()
        world.silent, world.visited = [False] * crowd.robots, simulator.visited.tolist()
        world.missing = [0] * crowd.robots
        world.seconds, world.t_max, world.expert_flowtime = 1 / crowd.rate, _TICKS, -1
        worlds.append(world)

    note(none, none)
    while not simulator.done:
        actions = rng.integers(5, size=crowd.robots)
        note(actions, simulator.step(actions).moved)
    return worlds


def bench_view(crowds: Iterable[Crowd], seconds: float, console: Console) -> Iterator[tuple[Crowd, Smoothness]]:
    """`measure` each of ``crowds``, with progress."""
    crowds = list(crowds)
    with progress_bars(console) as progress:
        task = progress.add_task("", total=len(crowds))
        for crowd in crowds:
            progress.update(task, description=f"{crowd.robots} robots")
            yield crowd, measure(crowd, seconds)
            progress.advance(task)


def table(results: Iterable[tuple[Crowd, Smoothness]]) -> Table:
    """The results for the terminal."""
    result = Table(
        caption="CPU: of one core; alone: without a browser", caption_justify="left", box=None, pad_edge=False
    )
    columns = ("robots", "map", "ticks/s", "frames/s", "draw p50 ms", "p95 ms", "server CPU", "alone", "browser CPU")
    for heading in columns:
        result.add_column(heading, justify="right", overflow="fold")
    for crowd, found in results:
        result.add_row(
            str(crowd.robots),
            f"{crowd.side}x{crowd.side}",
            f"{crowd.rate:g}",
            f"{found.frames_per_second:.0f}",
            f"{found.p50:.1f}",
            f"{found.p95:.1f}",
            f"{found.watched:.1%}",
            f"{found.alone:.1%}",
            f"{found.browser:.0%}",
        )
    return result
