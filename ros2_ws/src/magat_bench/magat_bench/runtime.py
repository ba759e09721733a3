# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""``magat bench-runtime``: ticks per second of a team by radio, backend and processes."""

import os
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import psutil
from rich.console import Console
from rich.table import Table

from magat_bringup.client import EpisodeClient, EpisodeOutcome
from magat_bringup.environment import network_for, own_domain
from magat_bringup.processes import TeamProcesses
from magat_bringup.team import PagePlan, TeamFile, TeamPlan
from magat_evaluation.splits import SET_SEED, SPLITS
from magat_interfaces.action import RunEpisode
from magat_node.errors import TeamError
from magat_node.progress import progress_bars
from magat_robot.policy.backends import load_policy
from magat_sim.streams import SECRET_BYTES
from magat_viewer.address import HOST as PAGE_HOST
from magat_viewer.address import free_port
from magat_viewer.follower import Follower

#: Limit for the start of a team, seconds.
READY = 300.0


@dataclass(frozen=True)
class RuntimeSetting:
    """A team to measure, on square maps with as many robots per cell as 20x20 with 10."""

    processes: int
    crew: int
    radio: str
    backend: str
    #: Whether the team is recorded.
    recorded: bool = False
    #: Whether a client follows the page, with a robot selected.
    viewed: bool = False

    @property
    def robots(self) -> int:
        """Robots in all processes."""
        return self.processes * self.crew

    @property
    def side(self) -> int:
        """Side of the map, cells."""
        return round((self.robots * 40) ** 0.5)


@dataclass(frozen=True)
class Speed:
    """Measures of a setting."""

    ticks: int
    ticks_per_second: float
    #: Wall time of a tick, milliseconds.
    p50: float
    p99: float
    #: Seconds from the first process to the first episode's start.
    startup: float
    #: Memory per robot (PSS: shared memory is divided among the processes that share it), MiB.
    memory: float
    #: Messages that did not arrive in time.
    missing: int


class _Timed:
    """A team in a ``with`` statement, with timed ticks."""

    def __init__(self, setting: RuntimeSetting, policy: Path) -> None:
        """Prepare a team of ``setting`` with ``policy``."""
        self.setting, self._policy = setting, policy
        self._stack = ExitStack()
        self._startup = 0.0

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            self._domain = stack.enter_context(own_domain())
            self._folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            setting = self.setting
            self._plan = TeamPlan(
                TeamFile.numbered(setting.robots, setting.crew),
                self._policy,
                radio=setting.radio,
                backend=setting.backend,
                ready_timeout=READY,
                record=self._folder / "bag" if setting.recorded else None,
            )
            network = network_for(self._domain, self._plan.nodes + 1)  # the page comes and goes
            self._plan = replace(self._plan, server=bool(network.server))
            self._variables = network.variables
            os.environ.update(self._variables)
            self._started = time.monotonic()
            self._team = stack.enter_context(TeamProcesses(self._plan, self._folder / "logs", self._variables))
            self._client = stack.enter_context(EpisodeClient(self._team, self._domain))
            self._client.wait_for_simulator(READY)
            if setting.recorded:
                self._client.wait_for_recorder()
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def time(self, ticks: int) -> Speed:
        """Run episodes, the same in each call, for at least ``ticks`` ticks."""
        seconds: list[float] = []
        missing, spent = 0, 0.0
        for number in SPLITS["test"]:
            outcome = self._episode(number)
            worlds = outcome.recording.worlds
            seconds += [worlds[tick].seconds for tick in sorted(worlds) if tick > 0]
            missing += outcome.result.features_missing
            spent += outcome.result.ticks / outcome.result.ticks_per_second
            if len(seconds) >= ticks:
                break
        memory = [psutil.Process(pid).memory_full_info().pss / 2**20 for pid in self._team.pids("robots")]
        p50, p99 = np.percentile(seconds, [50, 99]) * 1e3
        share = sum(memory) / self.setting.robots
        return Speed(len(seconds), len(seconds) / spent, p50, p99, self._startup, share, missing)

    @contextmanager
    def page(self) -> Iterator[None]:
        """Run the page of the team, with a client and a selected robot, within the ``with`` statement."""
        plan = PagePlan(self._plan.team, self._policy, view=free_port())
        with (
            TeamProcesses(plan, self._folder / "page", self._variables) as page,
            Follower(f"http://{PAGE_HOST}:{plan.view}/", chosen=0) as follower,
        ):
            deadline = time.monotonic() + READY
            while follower.last.get("detail", {}).get("no_attention") != "":  # the page shows the robot's attention
                page.check()
                if time.monotonic() > deadline:
                    raise TeamError(f"the page shows nothing of the chosen robot after {READY:g} s")
                self._episode(SPLITS["test"][0])
            yield

    def _episode(self, number: int) -> EpisodeOutcome:
        side = self.setting.side
        goal = RunEpisode.Goal(seed=SET_SEED, number=number, width=side, height=side)
        # Long enough for most episodes; robots with the backend echo walk at random and do not finish.
        goal.density, goal.t_max = 0.1, 4 * side
        # Always the same, so that all teams of one size walk the same paths.
        goal.secret = bytes(SECRET_BYTES)

        def note(feedback: RunEpisode.Feedback) -> None:
            self._startup = self._startup or (time.monotonic() - self._started if feedback.t_max else 0.0)

        return self._client.run(goal, note)


def measure(setting: RuntimeSetting, policy: Path, ticks: int) -> Speed:
    """Run episodes on a team of ``setting``, without the page, for at least ``ticks`` ticks.

    Raises:
        TeamError: the team cannot be started, or is not complete in time.
    """
    with _Timed(setting, policy) as team:
        return team.time(ticks)


def measure_viewed(
    setting: RuntimeSetting, policy: Path, ticks: int, turns: int
) -> Iterator[tuple[RuntimeSetting, Speed]]:
    """Measure one team with the page and without it, in ``turns`` turns.

    It is the same team because two starts differ by more than the page costs. Each turn runs the same episodes twice,
    for at least ``ticks`` ticks, and alternates which of the two is first.

    Raises:
        TeamError: as `measure`, or the page shows nothing.
    """
    with _Timed(setting, policy) as team:
        team.time(ticks)  # a warm-up
        for number in range(2 * turns):
            viewed = number % 4 in (1, 2)
            with team.page() if viewed else nullcontext():
                yield replace(setting, viewed=viewed), team.time(ticks)


def inference(policy: Path, backend: str, neighbours: int = 4, repetitions: int = 200) -> float:
    """Median time of one robot's perception, communication with ``neighbours`` robots, and decision, milliseconds."""
    loaded = load_policy(policy, backend)
    view = np.zeros((1, 3, 11, 11), dtype=np.uint8)
    present, stream = np.ones((1, neighbours), dtype=bool), np.zeros(1, dtype=np.uint64)
    spent = []
    for _ in range(repetitions):
        started = time.perf_counter()
        own = loaded.perceive(view)
        for size in loaded.config.message_sizes:
            own = loaded.hear(own, np.zeros((1, neighbours, size), dtype=np.float32), present)
        loaded.decide(own, stream, 0)
        spent.append(time.perf_counter() - started)
    return float(np.median(spent)) * 1e3


def bench_runtime(
    settings: Iterable[RuntimeSetting], policy: Path, ticks: int, turns: int, view: bool, console: Console
) -> Iterator[tuple[RuntimeSetting, Speed]]:
    """`measure` each of ``settings`` in ``turns`` turns, or `measure_viewed` if ``view``, with progress."""
    settings = list(settings)
    with progress_bars(console) as progress:
        task = progress.add_task("teams", total=turns * len(settings) * (1 + view))

        def named(setting: RuntimeSetting) -> RuntimeSetting:
            progress.update(
                task, description=f"{setting.processes} x {setting.crew}, {setting.radio}, {setting.backend}"
            )
            return setting

        if view:
            for setting in settings:
                for result in measure_viewed(named(setting), policy, ticks, turns):
                    progress.advance(task)
                    yield result
            return
        for number in range(turns):
            # Every other turn is backwards, because the speed of the machine changes with time.
            for setting in settings[:: -1 if number % 2 else 1]:
                yield named(setting), measure(setting, policy, ticks)
                progress.advance(task)


def summary(results: Iterable[tuple[RuntimeSetting, Speed]], inferences: Mapping[str, float]) -> str:
    """Sentences that compare settings, by medians over turns: with echo robots, with recording, with the page.

    Args:
        results: one or more of each setting.
        inferences: time of `inference` by backend, milliseconds.
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
            # Turn by turn, because the speed of the machine changes with time.
            changes = np.array(several) / np.array(alone) - 1
            lines.append(
                f"{setting.processes} x {setting.crew}, {setting.radio}, {setting.backend}: {np.median(several):.0f} "
                f"ticks/s {how}, {np.median(alone):.0f} not: {np.median(changes):+.1%}"
                + (f" ({changes.min():+.1%} to {changes.max():+.1%})" if len(changes) > 1 else "")
            )
    return "\n".join(lines)


def _by_setting(results: Iterable[tuple[RuntimeSetting, Speed]], name: str) -> dict[RuntimeSetting, list[float]]:
    """The values of the field ``name`` of `Speed` by setting, in the order of measurement."""
    values: dict[RuntimeSetting, list[float]] = {}
    for setting, speed in results:
        values.setdefault(setting, []).append(getattr(speed, name))
    return values


def table(results: Iterable[tuple[RuntimeSetting, Speed]]) -> Table:
    """The results for the terminal."""
    result = Table(box=None, pad_edge=False, collapse_padding=True)
    result.caption, result.caption_justify = "MiB: per robot; missing: messages", "left"
    columns = ("team", "radio", "with", "ticks", "ticks/s", "p50 ms", "p99 ms", "start s", "MiB", "missing")
    for heading in columns:
        result.add_column(heading, justify="right", overflow="fold")
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
