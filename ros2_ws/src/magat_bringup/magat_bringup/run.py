# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""``magat run``: starts a team of processes, runs episodes on it, and shows a table, a picture and an animation."""

import os
import shlex
from dataclasses import replace
from pathlib import Path
from time import monotonic

from rich.console import Console
from rich.progress import Progress

from magat_bringup import log_lines
from magat_bringup.checks import check_run
from magat_bringup.client import EpisodeClient, EpisodeError, EpisodeOutcome
from magat_bringup.environment import LOOPBACK, Network, network_for, own_domain
from magat_bringup.other_teams import refuse_other_team
from magat_bringup.processes import TeamProcesses
from magat_bringup.results import LEGEND, RunResults
from magat_bringup.run_folder import ANIMATION, LOGS, PICTURE, begin, run_folder
from magat_bringup.run_plan import RunPlan
from magat_bringup.team import TeamPlan
from magat_interfaces.action import RunEpisode
from magat_node.errors import MagatError
from magat_node.progress import progress_bars
from magat_pictures.animation import save_animation
from magat_pictures.drawn_episode import DrawnEpisode
from magat_pictures.picture import save_picture
from magat_recording.recovery import describe_recording, is_finished
from magat_viewer.address import HOST as PAGE_HOST


def run(plan: RunPlan, team: TeamPlan, console: Console) -> list[RunEpisode.Result]:
    """Run the episodes on the team and show them; returns the results of those that were run.

    However the run ends, the results of the episodes that have ended are in its folder, and their table is printed.

    Raises:
        MagatError: see `check_run`; no process was started. Or something is not complete: a case could not be run, or
            a file could not be written.
        TeamError: a process ended, or an episode could not be run for a reason that is not its case.
        NetworkError: there is no such interface.
        NoDomainError: the ROS domain is taken, by another run or by a team that was started otherwise.
        KeyboardInterrupt: interrupted; no process is left behind.
    """
    check_run(plan, team)
    with run_folder(plan.output) as folder:
        team = replace(team, record=plan.bag(folder))
        results = RunResults(folder, len(team.team.robots))
        try:
            last = _run_team(plan, team, folder, results, console)
        finally:
            # Where standard output was closed, as by `| head`, rich writes nothing to it any more.
            open_console = Console(stderr=True) if console.quiet else console
            _show(plan, results, open_console)
            if team.record is not None and team.record.is_dir():
                for line in describe_recording(team.record):
                    open_console.print(line, highlight=False, soft_wrap=True)
        if last is not None:
            _draw(plan, team, last, folder, console)
        problems = _problems(plan, results, team.record)
        if problems:
            raise MagatError("; ".join(problems))
    return results.run


def _run_team(
    plan: RunPlan, team: TeamPlan, folder: Path, results: RunResults, console: Console
) -> EpisodeOutcome | None:
    """Start the team, run the episodes, and end the team; returns the outcome of the last episode that was run."""
    crews = team.team
    processes = "one process each" if crews.crew == 1 else f"in {crews.processes} processes"
    with own_domain(plan.domain, team.namespace) as domain:
        network = network_for(domain, team.nodes, plan.interface)
        team = replace(team, server=bool(network.server))
        environment = network.variables
        os.environ.update(environment)  # for the client, which is in this process
        if not network.server:  # a server's team consists of those that use it
            refuse_other_team(domain, team.namespace)
        place = "on this machine only" if network.address == LOOPBACK else f"open to the network at {network.address}"
        console.print(
            f"[bold]{len(crews.robots)} robots[/], {processes}, with the policy [bold]{team.policy.name}[/] "
            f"on {plan.width}x{plan.height} cells, over ROS 2, {place}"
        )
        _invite(team, network, console)

        def show(process: str, line: str) -> None:
            text = log_lines.styled(process, line, plan.verbose)
            if text is not None:
                console.print(text)

        begin(folder, newest=plan.output is None)
        with (
            TeamProcesses(team, folder / LOGS, environment, show) as running,
            EpisodeClient(running, domain, team.namespace) as client,
            progress_bars(console) as progress,
        ):
            if team.record is not None:
                task = progress.add_task("the recorder joins the team", total=None)
                client.wait_for_recorder()
                progress.remove_task(task)
            last = _run_episodes(plan, team, client, progress, results)
        if "recorder" in running.given_up:
            results.problems.append(f"the recording is not complete: the recorder {running.given_up['recorder']}")
        return last


def _invite(team: TeamPlan, network: Network, console: Console) -> None:
    """Print how tools and robots that are started separately join the team."""
    join = f"magat env --domain {network.domain}" + (f" --server {network.server}" if network.server else "")
    if not team.robots:
        start = replace(team, robots=True).command("robots")
        console.print(f"The team waits {team.patience:g} s for its robots. Start them on each host:")
        console.print(f'  eval "$({join})"', soft_wrap=True, highlight=False, markup=False)
        console.print(f"  python -m {shlex.join(start.python)}", soft_wrap=True, highlight=False, markup=False)
    if team.view is not None:
        console.print(f"[bold]The page is at http://{PAGE_HOST}:{team.view}/[/]: open it in a browser")
    if team.rviz:
        console.print("RViz and other tools find the team in this environment:")
        console.print(f'  eval "$({join} --tools)"', soft_wrap=True, highlight=False, markup=False)


def _run_episodes(
    plan: RunPlan, team: TeamPlan, client: EpisodeClient, progress: Progress, results: RunResults
) -> EpisodeOutcome | None:
    started, robots = monotonic(), len(team.team.robots)
    joining = progress.add_task("robots found each other", total=robots)
    running = progress.add_task("episode", total=None, visible=False)
    client.wait_for_simulator(team.patience)
    last = None

    def show(feedback: RunEpisode.Feedback) -> None:
        if feedback.t_max == 0:
            progress.update(joining, completed=feedback.joined)
            return
        if not progress.tasks[joining].finished:
            progress.update(joining, completed=robots, description=f"team ready after {monotonic() - started:.1f} s")
        progress.update(
            running,
            description=f"episode {len(results.rows) + 1} of {plan.episodes}, {feedback.arrived} robots arrived",
            completed=feedback.tick,
            total=feedback.t_max,
            visible=True,
        )

    for index, name in enumerate(plan.names):
        try:
            last = client.run(plan.goal(index), show)
        except EpisodeError as error:
            results.add(name, error.result)
            if not error.of_case:  # the next episode would fail alike
                raise
            progress.console.print(
                f"episode {index + 1}: [bold red]not run[/], {plan.case(index)}: {error}", highlight=False
            )
            continue
        result = last.result
        results.add(name, result)
        progress.console.print(
            f"episode {index + 1}: {'complete' if result.success else 'not complete'} after {result.makespan} of "
            f"{result.t_max} ticks, {result.ticks_per_second:.0f} ticks/s"
        )
    progress.update(running, visible=False)
    return last


def _show(plan: RunPlan, results: RunResults, console: Console) -> None:
    """Print the table of what was done, and finish its file."""
    if results.rows:
        results.finish()
        console.print(results.table(plan.title))
        console.print(f"[dim]{LEGEND}[/]")


def _problems(plan: RunPlan, results: RunResults, bag: Path | None) -> list[str]:
    """What a run to its end lacks nevertheless."""
    not_run = [case for case, result in results.rows if result.error]
    return [
        *([f"{len(not_run)} of {plan.episodes} episodes were not run: {', '.join(not_run)}"] if not_run else []),
        *results.problems,
        *([f"the recording in {bag} was not finished"] if bag is not None and not is_finished(bag) else []),
    ]


def _draw(plan: RunPlan, team: TeamPlan, outcome: EpisodeOutcome, folder: Path, console: Console) -> None:
    """Draw the last episode."""
    log = outcome.recording
    if not outcome.recorded:
        console.print(
            f"There is no picture: {len(log.worlds)} of {outcome.result.ticks + 1} messages of the last episode came"
        )
        return
    record = DrawnEpisode(
        obstacles=log.obstacles,
        goals=log.goals,
        positions=log.positions,
        blocked=log.blocked,
        title=f"{team.policy.name}, {plan.width}x{plan.height}, {len(team.team.robots)} robots",
    )
    picture, animation = folder / PICTURE, folder / ANIMATION
    save_picture(record, picture)
    save_animation(record, animation)
    console.print(f"The last episode: {picture} and {animation}; results and logs are beside them.")
