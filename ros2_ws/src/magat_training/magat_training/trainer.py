# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Imitation of the expert: the training loop, resumable to the bit."""

import copy
import dataclasses
import json
import math
import shutil
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tensorboardX import SummaryWriter
from torch.nn.functional import cross_entropy

from magat_evaluation.cases import SolvedCase
from magat_evaluation.planners import evaluate
from magat_node.files import write_atomically
from magat_node.plain import plain
from magat_robot.policy.config import PolicyConfig
from magat_robot.policy.network import PolicyNetwork
from magat_robot.policy.policy import Policy
from magat_sim.measures import summarise
from magat_training.checkpoint import read_checkpoint, write_checkpoint
from magat_training.online import CORRECTIONS, correct_in_pieces
from magat_training.samples import Batch, Instants, Pool, Sampler
from magat_training.workers import ALONE, Workers


@dataclass(frozen=True)
class TrainConfig:
    """How a policy is trained. Defaults are the paper's values where it gives one.

    Raises:
        ValueError: an unknown way to ask the online expert.
    """

    policy: PolicyConfig = field(
        default_factory=lambda: PolicyConfig(channels=(32, 32, 128), cnn="centred", temperature=0.75)
    )
    #: Training cases (numbers from 0) and validation cases.
    train_cases: int = 21_000
    valid_cases: int = 300
    #: Optimiser steps, each on ``batch`` instants.
    steps: int = 24_000
    batch: int = 64
    #: Learning rate, cosine from first to last.
    first_rate: float = 2e-3
    last_rate: float = 1e-6
    #: L2 regularisation.
    weight_decay: float = 1e-5
    #: Steps between validations (simulated episodes) and checkpoints.
    validate_every: int = 1_000
    #: The online expert: it corrects every state that the policy visits ("states"), only the last states of failed
    #: episodes, as in the paper ("failures"), or nothing ("off").
    online: str = "states"
    #: From step ``online_from`` on, the policy runs ``online_cases`` training cases every ``online_every`` steps, and
    #: the expert corrects them. ``online_share`` of each batch comes from the last ``online_rounds`` of these rounds.
    online_from: int = 1_000
    online_every: int = 400
    online_cases: int = 300
    online_share: float = 0.75
    online_rounds: int = 8
    seed: int = 0

    def __post_init__(self) -> None:
        if self.online not in ("off", *CORRECTIONS):
            raise ValueError(f"unknown online expert {self.online!r}: it is one of {['off', *CORRECTIONS]}")


class Trainer:
    """One training run in a folder: its checkpoint, its best weights, its log.

    The log has two forms: ``log.jsonl``, a JSON object for each validation, and TensorBoard events in ``tensorboard/``.
    """

    def __init__(
        self,
        config: TrainConfig,
        folder: Path,
        train: list[SolvedCase],
        valid: list[SolvedCase],
        workers: Workers = ALONE,
        executor: Executor | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Start a run in ``folder``, or resume the run that is there.

        Args:
            config: how to train.
            folder: of the run. Files of a run that was interrupted before its first checkpoint are removed.
            train: cases to learn from.
            valid: cases to validate on.
            workers: the processes that train together.
            executor: does the work of the online expert; this process if None. The weights do not depend on it.
            clock: measures the seconds that are logged.

        Raises:
            ValueError: there are no cases; the run in ``folder`` has another configuration or is damaged; the batch
                cannot be divided among the processes; or there are too few cases for the online expert.
        """
        if config.batch % workers.count:
            raise ValueError(
                f"a batch of {config.batch} instants cannot be divided among {workers.count} processes: change either"
            )
        self.config = config
        self.folder = folder
        self.step = 0
        self.best = -math.inf
        self.seconds = 0.0
        #: Seconds that this process has spent in each part of the training, by name.
        self.spent: dict[str, float] = {}
        self._workers = workers
        self._executor = executor
        self._clock = clock
        self._train = train
        self._valid = valid
        self._sampler = Sampler(train)
        if config.online != "off" and min(config.online_cases, len(train)) < workers.count:
            raise ValueError(
                f"the online expert needs at least {workers.count} cases, one for each process: raise online_cases"
            )
        self._expert = self._sampler.pool(Instants.of_paths([s.paths for s in train], range(len(train))))
        #: What the online expert corrected, an entry for each round and process.
        self._corrections: list[Instants] = []
        self._online: Pool | None = None
        self._online_alpha = math.nan
        torch.manual_seed(config.seed)
        self.network = PolicyNetwork(config.policy)
        self._model = workers.wrap(self.network)
        self._optimiser = torch.optim.Adam(
            self.network.parameters(), config.first_rate, weight_decay=config.weight_decay, fused=True
        )
        folder.mkdir(parents=True, exist_ok=True)
        if self._checkpoint.exists():
            self._resume()
        elif workers.first:
            self._log.unlink(missing_ok=True)
            shutil.rmtree(folder / "tensorboard", ignore_errors=True)

    @property
    def _checkpoint(self) -> Path:
        return self.folder / "checkpoint.pt"

    @property
    def _log(self) -> Path:
        return self.folder / "log.jsonl"

    def run(self, on_step: Callable[[int, float], None] | None = None, until: int | None = None) -> None:
        """Train to the last step.

        Args:
            on_step: called with the step and its loss after each step.
            until: a step to stop at before. The next validation then logs the mean loss of what follows it only.
        """
        losses: list[float] = []
        last = self.config.steps if until is None else min(until, self.config.steps)
        while self.step < last:
            started = self._clock()
            if self._asks_online():
                with self._timed("online expert"):
                    self._ask_online_expert()
            losses.append(self.train_step())
            self.step += 1
            self.seconds += self._clock() - started
            if on_step is not None:
                on_step(self.step, losses[-1])
            if self.step % self.config.validate_every == 0 or self.step == self.config.steps:
                if self._workers.first:
                    with self._timed("validation"):
                        self._validate(float(np.mean(losses)))
                self._workers.wait()
                losses.clear()

    def best_network(self) -> PolicyNetwork:
        """The network with the best validation so far, see `score`."""
        network = PolicyNetwork(self.config.policy)
        network.load_state_dict(read_checkpoint(self.folder / "best.pt"))
        return network

    def train_step(self) -> float:
        """Make one optimiser step and return its loss; does not increase ``step``."""
        config, device = self.config, self._workers.device
        with self._timed("sampling"):
            batch = self._draw()
            view = torch.from_numpy(batch.view).to(device).float().contiguous(memory_format=torch.channels_last)
            heard, action = (torch.from_numpy(rows).to(device) for rows in (batch.heard, batch.action))
        done = 0.5 * (1 + math.cos(math.pi * self.step / config.steps))
        for group in self._optimiser.param_groups:
            group["lr"] = config.last_rate + (config.first_rate - config.last_rate) * done
        self.network.train()
        with self._timed("forward"):
            loss = cross_entropy(self._model(view, heard), action)
        with self._timed("backward"):
            self._optimiser.zero_grad()
            loss.backward()
        with self._timed("optimiser"):
            self._optimiser.step()
        return loss.item()

    def _draw(self) -> Batch:
        # Each step has its own random stream, so that a resumed run draws the same batches.
        rng = np.random.default_rng([self.config.seed, self.step, self._workers.rank])
        size = self.config.batch // self._workers.count
        if self._online is None:
            return self._sampler.batch(rng, [(self._expert, size)])
        online = round(size * self.config.online_share)
        return self._sampler.batch(rng, [(self._expert, size - online), (self._online, online)])

    def _asks_online(self) -> bool:
        config = self.config
        return config.online != "off" and self.step >= config.online_from and self.step % config.online_every == 0

    def _ask_online_expert(self) -> None:
        """Run training cases with the current policy, each process a share of them, and let the expert correct them."""
        # No process draws its batches from this stream: their ranks are lower.
        rng = np.random.default_rng([self.config.seed, self.step, self._workers.count])
        chosen = rng.choice(len(self._train), min(self.config.online_cases, len(self._train)), replace=False)
        mine = self._workers.share(chosen.tolist())
        self._workers.share_statistics(self.network)  # all run the policy that the checkpoint holds
        correct = CORRECTIONS[self.config.online]
        if self._executor is not None:
            correct = partial(correct_in_pieces, self._executor, correct)
        correction = correct(self._policy(visit_memory=0.0), self._train, mine, self.step)
        corrections = self._workers.everyones(correction)
        self._online_alpha = summarise([episode for one in corrections for episode in one.episodes]).alpha
        self._corrections += [one.instants for one in corrections if one.instants is not None]
        if self.config.online == "states":  # older states are of an older policy; failures are few, so all are kept
            self._corrections = self._corrections[-self.config.online_rounds * self._workers.count :]
        self._pool_corrections()

    def _pool_corrections(self) -> None:
        self._online = self._sampler.pool(Instants.join(self._corrections)) if self._corrections else None

    def _policy(self, **changes: Any) -> Policy:
        """The policy in its deployed form, with the current weights, on the processor; for changes see `load`."""
        network = self.network
        policy = Policy(network if self._workers.device.type == "cpu" else copy.deepcopy(network).cpu())
        policy.config = policy.config.with_changes(**changes)
        return policy

    def _validate(self, loss: float) -> None:
        measures = summarise(evaluate(self._policy(), self._valid))
        reached = score(measures.alpha, measures.delta_ft)
        if reached > self.best:
            self.best = reached
            write_checkpoint(self.folder / "best.pt", self._weights())
        record = {
            "step": self.step,
            "loss": loss,
            "seconds": self.seconds,
            "online_instants": 0 if self._online is None else len(self._online),
            "online_alpha": None if math.isnan(self._online_alpha) else self._online_alpha,
        }
        record |= dataclasses.asdict(measures)
        with self._log.open("a") as log:
            log.write(json.dumps(plain(record), allow_nan=False) + "\n")
        shown = {"rate": self._optimiser.param_groups[0]["lr"]}
        for name in ("loss", "seconds", "online_alpha", "alpha", "delta_ft", "p_rg", "moves_blocked"):
            if record[name] is not None:
                shown[name] = record[name]
        # One file for each validation: events are only safe in a closed file, and a resumed run does not repeat them.
        with SummaryWriter(
            str(self.folder / "tensorboard"), purge_step=self.step, filename_suffix=f".{self.step:08d}"
        ) as board:
            for name, value in shown.items():
                board.add_scalar(name, value, self.step)
        self._save()

    def _weights(self) -> dict[str, torch.Tensor]:
        return {name: tensor.cpu() for name, tensor in self.network.state_dict().items()}

    def _save(self) -> None:
        state = {
            "config": dataclasses.asdict(self.config),
            "workers": self._workers.count,
            "step": self.step,
            "best": self.best,
            "seconds": self.seconds,
            "online_alpha": self._online_alpha,
            "corrections": [
                {name: torch.from_numpy(array) for name, array in vars(instants).items()}
                for instants in self._corrections
            ],
            "network": self._weights(),
            "optimiser": self._optimiser.state_dict(),
        }
        write_checkpoint(self._checkpoint, state)

    def _resume(self) -> None:
        state = read_checkpoint(self._checkpoint)
        if state["config"] != dataclasses.asdict(self.config):
            raise ValueError(f"{self._checkpoint} belongs to a run with another configuration: choose another folder")
        if state["workers"] != self._workers.count:
            raise ValueError(
                f"{self._checkpoint} belongs to a run of {state['workers']} processes, not {self._workers.count}: "
                f"start {state['workers']}"
            )
        self.step, self.best, self.seconds = state["step"], state["best"], state["seconds"]
        if self._workers.first and self._log.exists():
            # A run that was killed between log and checkpoint repeats that validation; one that was killed while it
            # wrote the log has left half a line.
            lines = self._log.read_text().splitlines(keepends=True)
            kept = [line for line in lines if line.endswith("\n") and json.loads(line)["step"] <= self.step]
            with write_atomically(self._log) as draft:
                draft.write_text("".join(kept))
        self._online_alpha = state["online_alpha"]
        self._corrections = [
            Instants(**{name: tensor.numpy() for name, tensor in instants.items()}) for instants in state["corrections"]
        ]
        self._pool_corrections()
        self.network.load_state_dict(state["network"])
        self._optimiser.load_state_dict(state["optimiser"])

    @contextmanager
    def _timed(self, part: str) -> Iterator[None]:
        started = self._clock()
        try:
            yield
        finally:
            self.spent[part] = self.spent.get(part, 0.0) + self._clock() - started


def score(alpha: float, delta_ft: float) -> float:
    """The criterion for the best checkpoint: alpha - delta_FT."""
    return alpha - delta_ft
