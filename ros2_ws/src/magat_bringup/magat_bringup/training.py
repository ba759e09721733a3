"""``magat train``: cases, expert, imitation, and a policy folder at the end."""

import json
from pathlib import Path
from typing import Any

import torch
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn, track

from magat_robot.policy.config import PolicyConfig
from magat_robot.policy.store import save
from magat_training.cases import SET_SEED, SPLITS, SolvedCase, solved_cases
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
    digest = save(trainer.best_network(), folder, card(config, output))
    console.print(f"{name}, digest {digest[:12]}: {folder}")
    return folder


def _solved(numbers: range, what: str, console: Console) -> list[SolvedCase]:
    return list(track(solved_cases(numbers), what, total=len(numbers), console=console, transient=True))


def card(config: TrainConfig, run: Path) -> str:
    """The card of a policy trained in the folder ``run``: how, on what, and how its validation went, in Markdown."""
    records = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
    best = max(records, key=lambda record: record["alpha"] - 0.1 * record["delta_ft"])
    rows = [
        f"| {r['step']} | {r['step'] * config.batch * 10 / 1e6:.1f} | {r['seconds'] / 60:.0f} | {r['loss']:.4f} "
        f"| {r['alpha']:.3f} | {r['delta_ft']:.3f} | {r['p_rg']:.4f} |"
        for r in records
    ]
    return f"""# {config.policy.name}

A policy of decentralised multi-robot path planning (MAGAT, RA-L 2021), trained by imitation of ECBS (w = 1.1) on
20x20 cells with 10 robots and 10 % obstacles.

- Cases: {config.train_cases} for training, {config.valid_cases} for validation (seed {SET_SEED}, from number 0 and from
  number {SPLITS["valid"].start}).
- Training: {records[-1]["step"]} steps of {config.batch} instants, each turned by one of the 8 symmetries of the grid;
  Adam, {config.first_rate:g} to {config.last_rate:g} by cosine, L2 {config.weight_decay:g}, seed {config.seed}.
- Time: {records[-1]["seconds"] / 60:.0f} minutes on one core.
- Chosen: the checkpoint of step {best["step"]}, by alpha - 0.1 delta_FT in simulated validation episodes.
- Sampling temperature: {config.policy.temperature:g}. Shield in validation: idle. All measures are of the deployed
  (fixed-point) form.

Make it again: `magat train --policy {config.policy.name} --output runs/{config.policy.name.lower()}`

| step | million observations | minutes | loss | alpha | delta_FT | p_rg |
|---|---|---|---|---|---|---|
{chr(10).join(rows)}
"""
