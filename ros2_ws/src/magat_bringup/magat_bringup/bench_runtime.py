"""``magat bench-runtime``: how fast a team ticks, by radio and processes, and what of it is the network's."""

import os
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import psutil
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from magat_bringup.client import EpisodeClient
from magat_bringup.environment import network_for, own_domain
from magat_bringup.processes import TeamError, TeamProcesses
from magat_bringup.team import TeamFile, TeamPlan
from magat_interfaces.action import RunEpisode
from magat_robot.policy.deployment import load_policy
from magat_training.cases import SET_SEED, SPLITS
from magat_viewer.address import HOST as PAGE_HOST
from magat_viewer.address import free_port
from magat_viewer.follower import Follower

#: How long a team may take to come together, seconds.
READY = 300.0


@dataclass(frozen=True)
class Setting:
    """A team to be measured: on square maps as dense with robots as 20x20 with 10."""

    processes: int
    crew: int
    radio: str
    backend: str
    #: Whether all that the team says is recorded.
    recorded: bool = False
    #: Whether somebody follows it by the page, and looks at a robot.
    viewed: bool = False

    @property
    def robots(self) -> int:
        """In all processes."""
        return self.processes * self.crew

    @property
    def side(self) -> int:
        """Of the map, cells."""
        return round((self.robots * 40) ** 0.5)


@dataclass(frozen=True)
class Speed:
    """What was measured of a setting."""

    ticks: int
    ticks_per_second: float
    #: Wall time of a tick, milliseconds.
    p50: float
    p99: float
    #: Seconds from the first process to the first episode's start.
    startup: float
    #: Memory of a robot's own (PSS: shared memory divided by those that share it), MiB.
    memory: float
    #: Messages that were not there in time.
    missing: int


def measure(setting: Setting, policy: Path, ticks: int, encoding: str = "") -> Speed:
    """Run episodes on a team of ``setting`` for at least ``ticks`` ticks.

    Raises:
        TeamError: the team cannot be started, or does not come together.
    """
    with own_domain() as domain, tempfile.TemporaryDirectory() as folder:
        plan = TeamPlan(
            TeamFile.numbered(setting.robots, setting.crew),
            policy,
            radio=setting.radio,
            encoding=encoding,
            backend=setting.backend,
            ready_timeout=READY,
            record=Path(folder, "bag") if setting.recorded else None,
            view=free_port() if setting.viewed else None,
        )
        network = network_for(domain, plan.nodes)
        plan = replace(plan, server=bool(network.server))
        os.environ.update(network.variables)
        started = time.monotonic()
        startup = 0.0
        seconds: list[float] = []
        missing, spent = 0, 0.0
        with (
            TeamProcesses(plan, Path(folder, "logs"), network.variables) as team,
            EpisodeClient(team, domain) as client,
            ExitStack() as stack,
        ):
            client.wait_for_simulator(READY)
            if setting.viewed:
                follower = stack.enter_context(Follower(f"http://{PAGE_HOST}:{plan.view}/", chosen=0))
                if not client.spin(lambda: follower.counts["team"] > 0, READY):
                    raise TeamError(f"the page does not answer after {READY:g} s")
            if setting.recorded:
                client.wait_for_recorder()

            def note(feedback: RunEpisode.Feedback) -> None:
                nonlocal startup
                startup = startup or (time.monotonic() - started if feedback.t_max else 0.0)

            for number in SPLITS["test"]:
                # Long enough for most episodes; teams that walk at random never finish theirs.
                goal = RunEpisode.Goal(seed=SET_SEED, number=number, width=setting.side, height=setting.side)
                goal.density, goal.t_max = 0.1, 4 * setting.side
                outcome = client.run(goal, note)
                if setting.viewed and follower.last.get("detail", {}).get("why") != "":
                    continue  # the page is still loading the policy
                worlds = outcome.recording.worlds
                seconds += [worlds[tick].seconds for tick in sorted(worlds) if tick > 0]
                missing += outcome.result.features_missing
                spent += outcome.result.ticks / outcome.result.ticks_per_second
                if len(seconds) >= ticks:
                    break
            memory = [psutil.Process(pid).memory_full_info().pss / 2**20 for pid in team.pids("robots")]
    p50, p99 = np.percentile(seconds, [50, 99]) * 1e3
    return Speed(len(seconds), len(seconds) / spent, p50, p99, startup, sum(memory) / setting.robots, missing)


def inference(policy: Path, backend: str, neighbours: int = 4, repetitions: int = 200) -> float:
    """Milliseconds in which one robot looks, hears ``neighbours`` messages a round, and decides; the median."""
    loaded = load_policy(policy, backend)
    view = np.zeros((1, 3, 11, 11), dtype=np.uint8)
    present, stream = np.ones((1, neighbours), dtype=bool), np.zeros(1, dtype=np.uint64)
    spent = []
    for _ in range(repetitions):
        started = time.perf_counter()
        own = loaded.encode(view)
        for size in loaded.config.message_sizes:
            own = loaded.hear(own, np.zeros((1, neighbours, size), dtype=np.float32), present)
        loaded.decide(own, stream, 0)
        spent.append(time.perf_counter() - started)
    return float(np.median(spent)) * 1e3


def bench_runtime(
    settings: Iterable[Setting], policy: Path, ticks: int, console: Console
) -> Iterator[tuple[Setting, Speed]]:
    """`measure` each of ``settings``, with progress."""
    settings = list(settings)
    with Progress(console=console, transient=True) as progress:
        task = progress.add_task("teams", total=len(settings))
        for setting in settings:
            progress.update(
                task, description=f"{setting.processes} x {setting.crew}, {setting.radio}, {setting.backend}"
            )
            yield setting, measure(setting, policy, ticks)
            progress.advance(task)


def summary(results: Iterable[tuple[Setting, Speed]], inferences: Mapping[str, float]) -> str:
    """What a tick costs besides the messages, in sentences, by medians of what was measured several times.

    Args:
        results: of settings, one or more of each.
        inferences: milliseconds of one robot, by backend.
    """
    lines = [f"One robot's inference: {', '.join(f'{b} {ms:.2f} ms' for b, ms in inferences.items())}."]
    results = list(results)
    p50 = {setting: float(np.median(several)) for setting, several in _by_setting(results, "p50").items()}
    for setting, median in p50.items():
        echo = p50.get(replace(setting, backend="echo"))
        if setting.backend in inferences and echo is not None and not (setting.recorded or setting.viewed):
            bare = echo + inferences[setting.backend]
            lines.append(
                f"{setting.processes} x {setting.crew}, {setting.radio}, {setting.backend}: p50 {median:.1f} ms, "
                f"{median / bare:.1f} times echo robots' {echo:.1f} ms and one inference"
            )
    speeds = _by_setting(results, "ticks_per_second")
    for setting, several in speeds.items():
        alone = speeds.get(replace(setting, recorded=False, viewed=False))
        if (setting.recorded or setting.viewed) and alone is not None:
            how = "recorded" if setting.recorded else "viewed"
            # By turns, because the machine changes from one to the next.
            changes = np.array(several) / np.array(alone) - 1
            lines.append(
                f"{setting.processes} x {setting.crew}, {setting.radio}, {setting.backend}: {np.median(several):.0f} "
                f"ticks/s {how}, {np.median(alone):.0f} not: {np.median(changes):+.1%}"
                + (f" ({changes.min():+.1%} to {changes.max():+.1%})" if len(changes) > 1 else "")
            )
    return "\n".join(lines)


def _by_setting(results: Iterable[tuple[Setting, Speed]], name: str) -> dict[Setting, list[float]]:
    """The values of a `Speed`'s ``name`` by setting, in the order in which they were measured."""
    values: dict[Setting, list[float]] = {}
    for setting, speed in results:
        values.setdefault(setting, []).append(getattr(speed, name))
    return values


def table(results: Iterable[tuple[Setting, Speed]]) -> Table:
    """The results for people."""
    result = Table(box=None, pad_edge=False)
    columns = ("team", "radio", "computes", "ticks", "ticks/s", "p50 ms", "p99 ms", "start s", "MiB/robot",
               "missing")  # fmt: skip
    for heading in columns:
        result.add_column(heading, justify="right", no_wrap=True)
    for setting, speed in results:
        result.add_row(
            f"{setting.processes} x {setting.crew}" + " rec." * setting.recorded + " viewed" * setting.viewed,
            setting.radio,
            setting.backend,
            str(speed.ticks),
            f"{speed.ticks_per_second:.0f}",
            f"{speed.p50:.1f}",
            f"{speed.p99:.1f}",
            f"{speed.startup:.1f}",
            f"{speed.memory:.0f}",
            str(speed.missing),
        )
    return result
