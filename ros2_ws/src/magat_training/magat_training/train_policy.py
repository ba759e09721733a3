# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""``magat train``: makes the data set, trains a policy, writes its folder, and measures it."""

import dataclasses
import shutil
from pathlib import Path
from typing import Any

import torch
from rich.console import Console

from magat_evaluation.cases import SolvedCase
from magat_evaluation.measures_file import MEASURES, measure
from magat_evaluation.sets import STANDARD_SETS
from magat_evaluation.splits import SET_SEED, SET_SIZE, SPLITS
from magat_evaluation.tables import markdown
from magat_node import interruption
from magat_node.progress import progress_bars
from magat_robot.policy.backends import ensure_exported
from magat_robot.policy.config import ModelError
from magat_robot.policy.store import CARD, save
from magat_training.card import card
from magat_training.data import MANIFEST, read_data_set, read_manifest
from magat_training.make_data import make
from magat_training.recipe import RECIPE, read_recipe, write_recipe
from magat_training.trainer import TrainConfig, Trainer
from magat_training.workers import Workers


def train_policy(
    recipe: str,
    changes: dict[str, Any],
    data_folder: Path,
    output: Path | None,
    threads: int,
    measures: bool,
    console: Console,
) -> Path:
    """Train a policy, or resume a run that was interrupted.

    Processes started by torchrun train together; only the first one prints, writes files and measures.

    Args:
        recipe: see `read_recipe`.
        changes: fields of `TrainConfig`, or ``temperature``, that differ from the recipe.
        data_folder: the data set to train on; made if there is none.
        output: folder of the run, ``runs/[name]`` if None; the policy's folder is made in it.
        threads: of torch in each process.
        measures: whether to measure the trained policy on the standard sets.
        console: shows the progress.

    Returns:
        The policy's folder.

    Raises:
        ModelError: there is no such recipe, or the folder holds another run.
        KeyboardInterrupt: with a message that the training can be resumed.
    """
    config = _changed(read_recipe(recipe), changes)
    output = output or Path("runs") / config.policy.name.lower()
    torch.set_num_threads(threads)
    workers = Workers.join()
    try:
        if workers.first and not (data_folder / MANIFEST).exists():
            make(data_folder, sum(map(len, SPLITS.values())), SET_SEED, dict(SET_SIZE), console)
        workers.wait()
        train, valid = (
            _cases(data_folder, split, count)
            for split, count in (("train", config.train_cases), ("valid", config.valid_cases))
        )
        try:
            trainer = Trainer(config, output, train, valid, workers)
        except ValueError as error:
            raise ModelError(str(error)) from error
        _run(trainer, console, quiet=not workers.first)
    finally:
        workers.leave()
    folder = output / config.policy.name
    if workers.first:
        hardware = f"{workers.count} process(es) of {threads} thread(s)"
        _write_policy(trainer, folder, read_manifest(data_folder)["recipe"], hardware, measures, console)
    return folder


def _changed(config: TrainConfig, changes: dict[str, Any]) -> TrainConfig:
    if "temperature" in changes:
        policy = dataclasses.replace(config.policy, temperature=changes["temperature"])
        changes = {name: value for name, value in changes.items() if name != "temperature"} | {"policy": policy}
    return dataclasses.replace(config, **changes)


def _cases(folder: Path, split: str, count: int) -> list[SolvedCase]:
    solved = read_data_set(folder, split)
    if len(solved) < count:
        raise ModelError(
            f"{folder} holds {len(solved)} {split} cases, and the recipe asks for {count}: lower {split}_cases"
        )
    return solved[:count]


def _run(trainer: Trainer, console: Console, quiet: bool) -> None:
    if trainer.step and not quiet:
        console.print(f"resuming {trainer.folder} at step {trainer.step}")
    with progress_bars(Console(quiet=True) if quiet else console) as progress:
        task = progress.add_task("training", total=trainer.config.steps, completed=trainer.step)

        def show_progress(step: int, loss: float) -> None:
            interruption.check()
            progress.update(task, completed=step, description=f"loss {loss:.3f}")

        try:
            trainer.run(show_progress)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(f"the same command resumes the last checkpoint in {trainer.folder}") from None


def _write_policy(
    trainer: Trainer, folder: Path, cases: dict[str, Any], hardware: str, measures: bool, console: Console
) -> None:
    text = card(trainer.config, trainer.folder, cases, hardware)
    digest = save(trainer.best_network(), folder, text)
    write_recipe(trainer.config, folder / RECIPE)
    (folder / MEASURES).unlink(missing_ok=True)  # those of the weights before
    if measures:
        reports = measure(folder, STANDARD_SETS, console)
        (folder / CARD).write_text(f"{text}\n## Measures\n\n{markdown(reports, digest)}\n")
    shutil.copy(trainer.folder / "log.jsonl", folder / "log.jsonl")
    with console.status("exporting the policy for onnxruntime"):
        ensure_exported(folder)
    console.print(f"{trainer.config.policy.name}, digest {digest[:12]}: {folder}")
