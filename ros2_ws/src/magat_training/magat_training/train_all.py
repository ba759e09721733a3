# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""``magat train --all``: the family's trainings, one after another, and their policies to models/."""

import shutil
from pathlib import Path
from typing import Any

from rich.console import Console

from magat_evaluation.family import FAMILY, Training
from magat_node.errors import MagatError
from magat_node.lock import LockedError
from magat_node.progress import progress_bars
from magat_robot.policy.config import ModelError
from magat_robot.policy.folder import read_folder
from magat_training.recipe import recipe
from magat_training.train_policy import Options, changed, ensure_data, is_finished, train_policy
from magat_training.trainer import TrainConfig


def train_all(
    changes: dict[str, Any], runs: Path, models: Path | None, options: Options, console: Console
) -> dict[str, str]:
    """Train everything in `FAMILY` that is not finished; each run is in its own folder in ``runs``.

    Several processes may do this at the same time: each takes the next training that no other one is working on.

    Args:
        changes: see `changed`; they hold for every training.
        runs: folder of the runs.
        models: where finished policies that are `shipped` are copied to; nowhere if None.
        options: see `train_policy`.
        console: shows the progress.

    Returns:
        Why trainings failed, by name.

    Raises:
        MagatError: there is no data set, and it cannot be made.
        KeyboardInterrupt: with a message that the training can be resumed.
    """
    ensure_data(options, console)
    failed: dict[str, str] = {}
    elsewhere = []
    with progress_bars(console) as progress:
        task = progress.add_task("policies", total=len(FAMILY))
        for training in FAMILY:
            progress.update(task, description=f"policies: {training.name}")
            try:
                _train(training, changes, runs, models, options, console)
            except LockedError:
                elsewhere.append(training.name)
            except MagatError as error:
                failed[training.name] = str(error)
            except Exception as error:  # the others do not have to wait until this one is understood
                console.print_exception()
                failed[training.name] = repr(error)
            progress.advance(task)
    if elsewhere:
        console.print(f"in training by other processes: {', '.join(elsewhere)}")
    return failed


def config_of(training: Training, changes: dict[str, Any] | None = None) -> TrainConfig:
    """The recipe of ``training``: see `recipe`, with ``changes`` as `changed` takes them."""
    policy = {"name": training.policy, "taps": training.taps}
    return changed(recipe({"policy": policy, "seed": training.seed}), changes or {})


def install(folder: Path, models: Path) -> bool:
    """Copy the policy in ``folder`` into ``models``; returns False if these weights are there already.

    What `magat measure` and `magat tune` have added to the same weights in ``models`` is kept.

    Raises:
        MagatError: ``folder`` holds no policy, or the copy cannot be written.
    """
    target, draft = models / folder.name, models / f".{folder.name}.draft"
    try:
        if read_folder(target)[1] == read_folder(folder)[1]:
            return False
    except ModelError:
        read_folder(folder)  # it is the copy that is missing or damaged
    try:
        shutil.rmtree(draft, ignore_errors=True)
        shutil.copytree(folder, draft)
        shutil.rmtree(target, ignore_errors=True)
        draft.rename(target)
    except OSError as error:
        shutil.rmtree(draft, ignore_errors=True)
        raise MagatError(f"{target} cannot be written ({error}): make room, and run the command again") from error
    return True


def _train(
    training: Training,
    changes: dict[str, Any],
    runs: Path,
    models: Path | None,
    options: Options,
    console: Console,
) -> None:
    config, output = config_of(training, changes), runs / training.name
    if is_finished(config, output):
        console.print(f"{training.name} is finished: {output}")
    else:
        train_policy(config, output, options, console)
    if models is not None and training.shipped and install(output / training.name, models):
        console.print(f"{training.name} is now in {models}")
