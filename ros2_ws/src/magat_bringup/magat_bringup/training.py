"""``magat train``: cases, expert, imitation, and a policy folder at the end."""

import time
from pathlib import Path
from typing import Any

import torch
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn, track

from magat_robot.policy.config import PolicyConfig
from magat_robot.policy.store import save
from magat_training.card import card
from magat_training.cases import SPLITS, SolvedCase, solved_cases
from magat_training.data import write_cases
from magat_training.train import TrainConfig, Trainer


def train_policy(
    name: str,
    temperature: float | None,
    changes: dict[str, Any],
    threads: int,
    output: Path,
    console: Console,
) -> Path:
    """Train a policy, or go on with a run that was interrupted.

    Args:
        name: of the policy, as in the paper.
        temperature: for sampling; that of `TrainConfig` if None.
        changes: fields of `TrainConfig` that differ from its defaults.
        threads: for torch.
        output: folder of the run; the policy goes to a folder ``name`` in it.
        console: shows the progress.

    Returns:
        The policy's folder.

    Raises:
        ModelError: unknown name.
    """
    torch.set_num_threads(threads)
    policy = PolicyConfig(name, temperature=TrainConfig().policy.temperature if temperature is None else temperature)
    config = TrainConfig(policy=policy, **changes)
    train = _solved(SPLITS["train"][: config.train_cases], "training cases", console)
    valid = _solved(SPLITS["valid"][: config.valid_cases], "validation cases", console)
    trainer = Trainer(config, output, train, valid)
    if trainer.step:
        console.print(f"resuming {output} at step {trainer.step}")
    columns = [TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()]
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("training", total=config.steps, completed=trainer.step)
        trainer.run(lambda step, loss: progress.update(task, completed=step, description=f"loss {loss:.3f}"))
    folder = output / name
    digest = save(trainer.best_network(), folder, card(config, output, threads))
    console.print(f"{name}, digest {digest[:12]}: {folder}")
    return folder


def make_data(output: Path, cases: int, seed: int, size: dict[str, Any], console: Console) -> None:
    """Draw and solve the first ``cases`` cases under ``seed``, sized as `draw_case` takes it, and write ``output``."""
    started = time.monotonic()
    drawn = solved_cases(range(cases), seed, **size)
    solved = list(track(drawn, "cases", total=cases, console=console, transient=True))
    write_cases(output, seed, solved)
    megabytes = output.stat().st_size / 1e6
    console.print(
        f"{output}: {len(solved)} of {cases} cases solved, {megabytes:.1f} MB, {time.monotonic() - started:.1f} s"
    )


def _solved(numbers: range, what: str, console: Console) -> list[SolvedCase]:
    return list(track(solved_cases(numbers), what, total=len(numbers), console=console, transient=True))
