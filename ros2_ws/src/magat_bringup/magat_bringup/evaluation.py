"""``magat evaluate``: a policy on many cases, in the batched simulator, with progress."""

import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress, track
from rich.table import Table

from magat_robot.policy.policy import Policy
from magat_robot.policy.store import load
from magat_sim.case import InvalidCaseError
from magat_sim.measures import EpisodeMeasures, summarise
from magat_sim.simulator import DEFAULT_RULES, Rules
from magat_training.cases import SolvedCase, solved_cases
from magat_training.evaluate import evaluate

#: Robots simulated in lockstep, those of one case at least: more of them take more memory, and no less time each.
BATCH_ROBOTS = 1000


@dataclass(frozen=True)
class Setting:
    """How a policy is run, whatever the cases."""

    #: For sampling; the policy's own if None.
    temperature: float | None = None
    #: Of messages; the policy's own if empty.
    encoding: str = ""
    #: Of the worlds.
    rules: Rules = DEFAULT_RULES

    def load(self, folder: Path) -> Policy:
        """The policy in ``folder`` as it is run.

        Raises:
            ModelError: it cannot be used, or not so.
        """
        given = {"temperature": self.temperature, "encoding": self.encoding or None}
        return load(folder, **{name: value for name, value in given.items() if value is not None})


DEFAULT_SETTING = Setting()


def evaluate_policy(
    folder: Path,
    numbers: Sequence[int],
    seed: int,
    setting: Setting,
    size: dict[str, Any],
    console: Console,
) -> dict[str, Any]:
    """Score the policy in ``folder`` on the cases ``numbers`` under ``seed``.

    Args:
        folder: of the policy.
        numbers: of the cases.
        seed: of cases and random streams.
        setting: how the policy is run.
        size: width, height, robots and density of the cases.
        console: shows the progress.

    Returns:
        Plain JSON values: what was measured, on what, with 95 % intervals.

    Raises:
        InvalidCaseError: no such cases can be drawn, or the expert solves none of them.
        ModelError: the policy cannot be used, or not in this setting.
    """
    policy = setting.load(folder)
    solving = solved_cases(numbers, seed, **size)
    # Where nobody watches, each bar would leave an empty line.
    hidden = not console.is_interactive
    solved = list(track(solving, "expert", total=len(numbers), console=console, transient=True, disable=hidden))
    if not solved:
        raise InvalidCaseError(f"the expert solves none of the {len(numbers)} cases: ask for more, or for easier ones")
    started = time.monotonic()
    episodes = _episodes(policy, solved, seed, setting.rules, console)
    elapsed = time.monotonic() - started
    return {
        "policy": policy.config.name,
        "digest": policy.digest,
        "temperature": policy.config.temperature,
        "encoding": policy.config.encoding,
        **dataclasses.asdict(setting.rules),
        **size,
        "seed": seed,
        "first_case": numbers[0],
        "unsolved_by_expert": len(numbers) - len(solved),
        **dataclasses.asdict(summarise(episodes)),
        "seconds": round(elapsed, 1),
    }


def _episodes(
    policy: Policy, solved: list[SolvedCase], seed: int, rules: Rules, console: Console
) -> list[EpisodeMeasures]:
    episodes: list[EpisodeMeasures] = []
    size = max(1, BATCH_ROBOTS // solved[0].case.robots)
    with Progress(console=console, transient=True, disable=not console.is_interactive) as progress:
        for start in range(0, len(solved), size):
            batch = solved[start : start + size]
            task = progress.add_task(f"episodes {start + 1} to {start + len(batch)} of {len(solved)}")
            progress.update(task, total=max(case.t_max for case in batch))
            episodes += evaluate(policy, batch, seed, lambda _, task=task: progress.advance(task), rules)  # type: ignore[misc]
            progress.remove_task(task)
    return episodes


def set_name(report: dict[str, Any]) -> str:
    """What ``report`` was measured on, e.g. 20x20 (10): cells and robots."""
    return f"{report['width']}x{report['height']} ({report['robots']})"


def table(report: dict[str, Any]) -> Table:
    """``report`` for people."""
    title = (
        f"{report['policy']}, T = {report['temperature']:g}, {report['encoding']}, {report['link_loss']:.0%} of links "
        f"lost, {report['shield']} shield: {report['cases']} cases of {set_name(report)}"
    )
    result = Table(title=title, title_justify="left")
    for heading in ("measure", "value", "95 % interval"):
        result.add_column(heading, justify="right")
    for name in ("alpha", "alpha_strict"):
        low, high = report[f"{name}_interval"]
        result.add_row(name, f"{report[name]:.3f}", f"{low:.3f} to {high:.3f}")
    half = report["delta_ft_half_width"]
    result.add_row(
        "delta_FT",
        f"{report['delta_ft']:.3f}",
        f"{report['delta_ft'] - half:.3f} to {report['delta_ft'] + half:.3f}",
    )
    for name, label in (("delta_ft_strict", "delta_FT, strict"), ("p_rg", "p_rg"), ("makespan", "makespan"),
                        ("moves_blocked", "moves blocked a case")):  # fmt: skip
        result.add_row(label, f"{report[name]:.3f}", "")
    return result
