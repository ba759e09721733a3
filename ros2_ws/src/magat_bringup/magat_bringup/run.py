"""``magat run``: starts a team of processes, runs episodes on it, and shows a table, a picture and an animation."""

import json
import os
import shlex
from dataclasses import replace
from time import monotonic

from rich.box import SIMPLE
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from magat_bringup import log_lines
from magat_bringup.checks import check_run
from magat_bringup.client import EpisodeClient, EpisodeOutcome
from magat_bringup.environment import LOOPBACK, Network, network_for, own_domain
from magat_bringup.processes import TeamProcesses
from magat_bringup.run_plan import RunPlan
from magat_bringup.team import TeamPlan
from magat_interfaces.action import RunEpisode
from magat_node.plain import plain
from magat_node.progress import progress_bars
from magat_pictures.animation import save_animation
from magat_pictures.drawn_episode import DrawnEpisode
from magat_pictures.picture import save_picture
from magat_sim.measures import wilson
from magat_viewer.address import HOST as PAGE_HOST


def run(plan: RunPlan, team: TeamPlan, console: Console) -> list[RunEpisode.Result]:
    """Run the episodes on the team and show them.

    Raises:
        MagatError: see `check_run`; no process was started.
        TeamError: a process ended, or an episode could not be run.
        NetworkError: there is no such interface.
        NoDomainError: the ROS domain is taken.
        KeyboardInterrupt: interrupted; no process is left behind.
    """
    check_run(plan, team)
    crews = team.team
    robots = len(crews.robots)
    processes = "one process each" if crews.crew == 1 else f"in {crews.processes} processes"
    outcomes: list[EpisodeOutcome] = []
    with own_domain(plan.domain) as domain:
        network = network_for(domain, team.nodes, plan.interface)
        team = replace(team, server=bool(network.server))
        environment = network.variables
        os.environ.update(environment)  # for the client, which is in this process
        place = "on this machine only" if network.address == LOOPBACK else f"open to the network at {network.address}"
        console.print(
            f"[bold]{robots} robots[/], {processes}, with the policy [bold]{team.policy.name}[/] "
            f"on {plan.width}x{plan.height} cells, over ROS 2, {place}"
        )
        _invite(team, network, console)

        def show(process: str, line: str) -> None:
            text = log_lines.styled(process, line, plan.verbose)
            if text is not None:
                console.print(text)

        with (
            TeamProcesses(team, plan.output / "logs", environment, show) as running,
            EpisodeClient(running, domain) as client,
            progress_bars(console) as progress,
        ):
            if team.record is not None:
                task = progress.add_task("the recorder joins the team", total=None)
                client.wait_for_recorder()
                progress.remove_task(task)
            _run_episodes(plan, team, client, progress, outcomes)
    results = [outcome.result for outcome in outcomes]
    console.print(_table(plan, robots, results))
    console.print(
        "[dim]B/tick: bytes of the feature message that a robot sends in a tick; blocked: moves that the "
        "shield did not allow; missing: features that did not arrive in time[/]"
    )
    _write(plan, team, outcomes, console)
    if team.record is not None:
        console.print(f"The recording is in {team.record}: analyse it by `magat analyze {team.record}`.")
    return results


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
    plan: RunPlan, team: TeamPlan, client: EpisodeClient, progress: Progress, outcomes: list[EpisodeOutcome]
) -> None:
    started, robots = monotonic(), len(team.team.robots)
    joining = progress.add_task("robots found each other", total=robots)
    running = progress.add_task("episode", total=None, visible=False)
    client.wait_for_simulator(team.patience)

    def show(feedback: RunEpisode.Feedback) -> None:
        if feedback.t_max == 0:
            progress.update(joining, completed=feedback.joined)
            return
        if not progress.tasks[joining].finished:
            progress.update(joining, completed=robots, description=f"team ready after {monotonic() - started:.1f} s")
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


def _table(plan: RunPlan, robots: int, results: list[RunEpisode.Result]) -> Table:
    count, complete = len(results), sum(result.success for result in results)
    low, high = wilson(complete, count)
    table = Table(
        title=plan.title,
        caption=f"alpha {complete / count:.2f} (95 % interval {low:.2f} to {high:.2f}, {count} cases)",
        title_justify="left",
        caption_justify="left",
        box=SIMPLE,
        padding=0,  # nine columns fit into a terminal of 80
    )
    for heading in ("case", "complete", "delta_FT", "ticks", "T_max", "ticks/s", "B/tick", "blocked", "missing"):
        table.add_column(heading, justify="right", no_wrap=True)
    for name, result in zip(plan.names, results, strict=True):
        table.add_row(
            name,
            "yes" if result.success else f"{round(result.p_rg * robots)} of {robots}",
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


def _write(plan: RunPlan, team: TeamPlan, outcomes: list[EpisodeOutcome], console: Console) -> None:
    fields = RunEpisode.Result.get_fields_and_field_types()
    results = [{name: getattr(outcome.result, name) for name in fields} for outcome in outcomes]
    (plan.output / "results.json").write_text(json.dumps(plain(results), indent=1, allow_nan=False) + "\n")
    last = outcomes[-1].recording
    record = DrawnEpisode(
        obstacles=last.obstacles,
        goals=last.goals,
        positions=last.positions,
        blocked=last.blocked,
        title=f"{team.policy.name}, {plan.width}x{plan.height}, {len(team.team.robots)} robots",
    )
    picture, animation = plan.output / "episode.png", plan.output / "episode.gif"
    save_picture(record, picture)
    save_animation(record, animation)
    console.print(f"The last episode: {picture} and {animation}; results and logs are beside them.")
