"""``magat run``: a team of processes, episodes on it, a table, a picture and an animation."""

import json
import os
from dataclasses import dataclass, replace
from pathlib import Path
from time import monotonic

from rich.box import SIMPLE
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
)
from rich.table import Table

from magat_bringup.animation import save_animation
from magat_bringup.client import EpisodeClient, EpisodeOutcome
from magat_bringup.environment import loopback, own_domain
from magat_bringup.models import find_policy
from magat_bringup.picture import save_picture
from magat_bringup.processes import TeamPlan, TeamProcesses
from magat_bringup.record import EpisodeRecord
from magat_bringup.team import TeamFile
from magat_interfaces.action import RunEpisode
from magat_sim.measures import wilson


@dataclass(frozen=True)
class RunPlan:
    """Which episodes to run, with whom."""

    episodes: int
    robots: int
    width: int
    height: int
    density: float
    #: Episodes are the cases ``first``, ``first + 1``, ... under ``seed``.
    seed: int
    first: int
    policy: str
    #: Folder for logs, results and pictures.
    output: Path

    def goal(self, index: int) -> RunEpisode.Goal:
        """The request for episode ``index``, from 0."""
        return RunEpisode.Goal(
            seed=self.seed,
            number=self.first + index,
            width=self.width,
            height=self.height,
            density=self.density,
        )


def run(
    plan: RunPlan,
    console: Console,
    *,
    team: TeamFile | None = None,
    radio: str = "direct",
    encoding: str = "",
    backend: str = "torch",
    params: Path | None = None,
    view: bool = False,
) -> list[RunEpisode.Result]:
    """Run the episodes and show them.

    Args:
        plan: the episodes.
        console: to show them on.
        team: the robots, instead of as many as the plan says with names of their numbers.
        radio: direct (robots hear each other) or relayed (through the simulator).
        encoding: of messages; that of the policy's configuration if empty.
        backend: what computes the policy: torch or onnx.
        params: ROS parameter file for every process.
        view: whether there is a view for RViz and the like.

    Raises:
        ModelError: there is no such policy.
        TeamFileError: there is no such parameter file.
        TeamError: a process ended, or an episode could not be run.
        KeyboardInterrupt: interrupted; no process is left behind.
    """
    policy = find_policy(plan.policy)
    team = team or TeamFile.numbered(plan.robots)
    plan = replace(plan, robots=len(team.robots))
    processes = "one process each" if team.crew == 1 else f"in {team.processes} processes"
    console.print(
        f"[bold]{plan.robots} robots[/], {processes}, carry [bold]{policy.name}[/] on {plan.width}x{plan.height} "
        f"cells; they talk over ROS 2, on this machine only"
    )
    outcomes: list[EpisodeOutcome] = []
    with own_domain() as domain:
        environment = loopback(domain)
        os.environ.update(environment)  # for the client, which is in this process
        if view:
            console.print(f"The view is in ROS domain {domain}; RViz needs this environment:")
            console.print(" ".join(f"{name}={value}" for name, value in environment.items()), soft_wrap=True)
        team_plan = TeamPlan(
            robots=team.robots,
            policy=policy,
            logs=plan.output / "logs",
            environment=environment,
            crew=team.crew,
            radio=radio,
            encoding=encoding,
            backend=backend,
            params=params,
            view=view,
        )
        with (
            TeamProcesses(team_plan) as running,
            EpisodeClient(running, domain) as client,
            _progress(console) as progress,
        ):
            _run_episodes(plan, client, progress, outcomes)
    results = [outcome.result for outcome in outcomes]
    console.print(_table(plan, results))
    console.print(
        "[dim]B/tick: bytes of the feature message that a robot sends in a tick; blocked: moves that the shield turned "
        "into IDLE; missing: features that did not arrive in time[/]"
    )
    _write(plan, policy.name, outcomes, console)
    return results


def _run_episodes(plan: RunPlan, client: EpisodeClient, progress: Progress, outcomes: list[EpisodeOutcome]) -> None:
    started = monotonic()
    joining = progress.add_task("robots found each other", total=plan.robots)
    running = progress.add_task("episode", total=None, visible=False)
    client.wait_for_simulator()

    def show(feedback: RunEpisode.Feedback) -> None:
        if feedback.t_max == 0:
            progress.update(joining, completed=feedback.joined)
            return
        if not progress.tasks[joining].finished:
            progress.update(
                joining, completed=plan.robots, description=f"team ready after {monotonic() - started:.1f} s"
            )
        progress.update(
            running,
            description=f"episode {len(outcomes) + 1} of {plan.episodes}, {feedback.arrived} robots arrived",
            completed=feedback.tick,
            total=feedback.t_max,
            visible=True,
        )

    for index in range(plan.episodes):
        outcomes.append(client.run(plan.goal(index), show))
        result = outcomes[-1].result
        progress.console.print(
            f"episode {index + 1}: {'complete' if result.success else 'not complete'} after {result.makespan} of "
            f"{result.t_max} ticks, {result.ticks_per_second:.0f} ticks/s"
        )
    progress.update(running, visible=False)


def _progress(console: Console) -> Progress:
    columns = [TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()]
    return Progress(SpinnerColumn(), *columns, console=console, transient=True)


def _table(plan: RunPlan, results: list[RunEpisode.Result]) -> Table:
    count, complete = len(results), sum(result.success for result in results)
    low, high = wilson(complete, count)
    table = Table(
        title=f"Cases {plan.first} to {plan.first + count - 1} of seed {plan.seed}",
        caption=f"alpha {complete / count:.2f} (95 % interval {low:.2f} to {high:.2f}, {count} cases)",
        title_justify="left",
        caption_justify="left",
        box=SIMPLE,
        padding=0,  # nine columns fit into a terminal of 80
    )
    for heading in ("case", "complete", "delta_FT", "ticks", "T_max", "ticks/s", "B/tick", "blocked", "missing"):
        table.add_column(heading, justify="right", no_wrap=True)
    for index, result in enumerate(results):
        table.add_row(
            str(plan.first + index),
            "yes" if result.success else f"{round(result.p_rg * plan.robots)} of {plan.robots}",
            f"{result.delta_ft:.1%}",
            str(result.ticks),
            str(result.t_max),
            f"{result.ticks_per_second:.0f}",
            f"{result.bytes_per_tick:.0f}",
            str(result.moves_blocked),
            str(result.features_missing),
        )
    ticks = sum(result.ticks for result in results)
    seconds = sum(result.ticks / result.ticks_per_second for result in results if result.ticks)
    table.add_section()
    table.add_row(
        "all",
        f"{complete} of {count}",
        f"{sum(result.delta_ft for result in results) / count:.1%}",
        str(ticks),
        str(sum(result.t_max for result in results)),
        f"{ticks / seconds:.0f}" if seconds else "",
        f"{sum(result.bytes_per_tick for result in results) / count:.0f}",
        str(sum(result.moves_blocked for result in results)),
        str(sum(result.features_missing for result in results)),
        style="bold",
    )
    return table


def _write(plan: RunPlan, policy: str, outcomes: list[EpisodeOutcome], console: Console) -> None:
    fields = RunEpisode.Result.get_fields_and_field_types()
    results = [{name: getattr(outcome.result, name) for name in fields} for outcome in outcomes]
    (plan.output / "results.json").write_text(json.dumps(results, indent=1) + "\n")
    last = outcomes[-1].recording
    record = EpisodeRecord(
        obstacles=last.obstacles,
        goals=last.goals,
        positions=last.positions,
        blocked=last.blocked,
        title=f"{policy}, {plan.width}x{plan.height}, {plan.robots} robots",
    )
    picture, animation = plan.output / "episode.png", plan.output / "episode.gif"
    save_picture(record, picture)
    save_animation(record, animation)
    console.print(f"The last episode: {picture} and {animation}; results and logs are beside them.")
