# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""``magat train``: makes the data set, trains a policy, writes its folder, and measures it."""

import dataclasses
import shutil
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from rich.console import Console

from magat_evaluation import executor as executors
from magat_evaluation.cases import SolvedCase
from magat_evaluation.family import Training
from magat_evaluation.measures_file import MEASURES, measure
from magat_evaluation.sets import STANDARD_SETS
from magat_evaluation.splits import SET_SEED, SET_SIZE, SPLITS
from magat_evaluation.tables import markdown
from magat_node import interruption
from magat_node.errors import MagatError
from magat_node.lock import locked
from magat_node.progress import progress_bars
from magat_robot.policy.backends import ensure_exported
from magat_robot.policy.config import ModelError
from magat_robot.policy.folder import read_folder
from magat_robot.policy.store import CARD, save
from magat_training.card import card
from magat_training.data import MANIFEST, read_data_set, read_manifest
from magat_training.make_data import make
from magat_training.recipe import RECIPE, read_recipe, write_recipe
from magat_training.trainer import TrainConfig, Trainer
from magat_training.workers import Workers


@dataclass(frozen=True)
class Options:
    """How a policy is trained, besides its recipe."""

    #: The data set to train on; made if there is none.
    data: Path
    #: Of torch in each process.
    threads: int = 1
    #: Whether to measure the trained policy on the standard sets.
    measures: bool = True
    #: Where the online expert does its work, and new cases are solved.
    workers: executors.Workers = 1


def train_policy(config: TrainConfig, output: Path, options: Options, console: Console) -> Path:
    """Train a policy, or resume a run that was interrupted.

    Processes started by torchrun train together; only the first one prints, writes files and measures.

    Args:
        config: its recipe.
        output: folder of the run; the policy's folder is made in it.
        options: everything else.
        console: shows the progress.

    Returns:
        The policy's folder.

    Raises:
        LockedError: another process trains in the folder.
        MagatError: the folder holds another run, is damaged or cannot be written; or the workers cannot be used.
        KeyboardInterrupt: with a message that the training can be resumed.
    """
    torch.set_num_threads(options.threads)
    workers = Workers.join()
    folder = output / training_of(config).name
    try:
        with (
            locked(output) if workers.first else nullcontext(),
            nullcontext() if options.workers == 1 else executors.executor(options.workers) as pool,
        ):
            if workers.first:
                ensure_data(options, console)
            workers.wait()
            train, valid = (
                _cases(options.data, split, count)
                for split, count in (("train", config.train_cases), ("valid", config.valid_cases))
            )
            trainer = Trainer(config, output, train, valid, workers, pool)
            _run(trainer, console, quiet=not workers.first)
            if workers.first:
                hardware = f"{workers.count} process(es) of {options.threads} thread(s)"
                cases = read_manifest(options.data)["recipe"]
                _write_policy(trainer, folder, cases, hardware, options.measures, console)
    except OSError as error:
        raise ModelError(
            f"{output} cannot be written ({error.strerror or error}): make room, and run the command again to resume"
        ) from error
    except ValueError as error:
        raise error if isinstance(error, MagatError) else ModelError(str(error)) from error
    finally:
        workers.leave()
    return folder


def ensure_data(options: Options, console: Console) -> None:
    """Make the data set if there is none."""
    if not (options.data / MANIFEST).exists():
        make(options.data, sum(map(len, SPLITS.values())), SET_SEED, dict(SET_SIZE), console, options.workers)


def training_of(config: TrainConfig) -> Training:
    """The policy, seed and taps of ``config``, which name its folders."""
    return Training(config.policy.name, config.seed, config.policy.taps)


def is_finished(config: TrainConfig, output: Path) -> bool:
    """Whether the run in ``output`` has written its policy, by the recipe ``config``, and the weights are intact."""
    folder = output / training_of(config).name
    try:
        read_folder(folder)
        return read_recipe(str(folder / RECIPE)) == config
    except ModelError:
        return False


def changed(config: TrainConfig, changes: dict[str, Any]) -> TrainConfig:
    """``config`` with ``changes``: fields of `TrainConfig`, or the sampling ``temperature``."""
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
    (folder / RECIPE).unlink(missing_ok=True)
    text = card(trainer.config, trainer.folder, cases, hardware)
    digest = save(trainer.best_network(), folder, text)
    (folder / MEASURES).unlink(missing_ok=True)  # those of the weights before
    if measures:
        reports = measure(folder, STANDARD_SETS, console)
        (folder / CARD).write_text(f"{text}\n## Measures\n\n{markdown(reports, digest)}\n")
    shutil.copy(trainer.folder / "log.jsonl", folder / "log.jsonl")
    with console.status("exporting the policy for onnxruntime"):
        ensure_exported(folder)
    write_recipe(trainer.config, folder / RECIPE)  # the last file: a folder with a recipe is complete
    console.print(f"{trainer.config.policy.name}, digest {digest[:12]}: {folder}")
