"""Imitation of the expert: the training loop, resumable to the bit."""

import dataclasses
import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.nn.functional import cross_entropy

from magat_robot.policy.config import PolicyConfig
from magat_robot.policy.network import PolicyNetwork
from magat_robot.policy.policy import Policy
from magat_sim.measures import summarise
from magat_training.cases import SolvedCase
from magat_training.evaluate import evaluate
from magat_training.online import solve, stuck_cases
from magat_training.samples import Samples


@dataclass(frozen=True)
class TrainConfig:
    """How a policy is trained. The paper's values where the paper gives one."""

    policy: PolicyConfig = field(default_factory=lambda: PolicyConfig(temperature=1.5))
    #: Training cases (numbers from 0) and validation cases.
    train_cases: int = 21_000
    valid_cases: int = 300
    #: Optimiser steps, each on ``batch`` instants.
    steps: int = 12_000
    batch: int = 64
    #: Learning rate, cosine from first to last.
    first_rate: float = 1e-3
    last_rate: float = 1e-6
    #: L2 regularisation.
    weight_decay: float = 1e-5
    #: Steps between validations (simulated episodes) and checkpoints.
    validate_every: int = 1_000
    #: From the step ``online_from`` on, every ``online_every`` steps, the online expert looks at ``online_cases``
    #: training episodes; ``online_share`` of each batch then comes from what it added.
    online_from: int = 2_000
    online_every: int = 1_000
    online_cases: int = 600
    online_share: float = 0.25
    seed: int = 0


class Trainer:
    """One training run in a folder: its checkpoint, its best weights, its log (a JSON object a line)."""

    def __init__(
        self,
        config: TrainConfig,
        folder: Path,
        train: list[SolvedCase],
        valid: list[SolvedCase],
    ) -> None:
        """Start a run in ``folder``, or resume the one that is there."""
        self.config = config
        self.folder = folder
        self.step = 0
        self.best = -math.inf
        self.seconds = 0.0
        self._train = train
        self._samples = Samples(train)
        self._stuck: list[SolvedCase] = []
        self._online: Samples | None = None
        self._valid = valid
        torch.manual_seed(config.seed)
        self.network = PolicyNetwork(config.policy).to(memory_format=torch.channels_last)
        self._optimiser = torch.optim.Adam(
            self.network.parameters(), config.first_rate, weight_decay=config.weight_decay
        )
        folder.mkdir(parents=True, exist_ok=True)
        if self._checkpoint.exists():
            self._resume()

    @property
    def _checkpoint(self) -> Path:
        return self.folder / "checkpoint.pt"

    @property
    def _log(self) -> Path:
        return self.folder / "log.jsonl"

    def run(self, on_step: Callable[[int, float], None] | None = None) -> None:
        """Train to the last step; ``on_step`` gets the step and the loss."""
        losses: list[float] = []
        while self.step < self.config.steps:
            started = time.monotonic()
            if self.step >= self.config.online_from and self.step % self.config.online_every == 0:
                self._ask_online_expert()
            losses.append(self._train_step())
            self.step += 1
            self.seconds += time.monotonic() - started
            if on_step is not None:
                on_step(self.step, losses[-1])
            if self.step % self.config.validate_every == 0 or self.step == self.config.steps:
                self._validate(float(np.mean(losses)))
                losses.clear()

    def best_network(self) -> PolicyNetwork:
        """The network of the best validation so far."""
        network = PolicyNetwork(self.config.policy)
        network.load_state_dict(torch.load(self.folder / "best.pt", weights_only=True))
        return network

    def _train_step(self) -> float:
        config = self.config
        # Each step draws from a stream of its own, so that a resumed run goes on as if nothing had happened.
        rng = np.random.default_rng([config.seed, self.step])
        online = round(config.batch * config.online_share) if self._online is not None else 0
        batch = self._samples.batch(rng, config.batch - online)
        if self._online is not None and online:
            batch = batch.join(self._online.batch(rng, online))
        share = 0.5 * (1 + math.cos(math.pi * self.step / config.steps))
        for group in self._optimiser.param_groups:
            group["lr"] = config.last_rate + (config.first_rate - config.last_rate) * share
        self.network.train()
        view = torch.from_numpy(batch.view).float().contiguous(memory_format=torch.channels_last)
        loss = cross_entropy(self.network(view, torch.from_numpy(batch.heard)), torch.from_numpy(batch.action))
        self._optimiser.zero_grad()
        loss.backward()
        self._optimiser.step()
        return loss.item()

    def _ask_online_expert(self) -> None:
        """Append cases that begin where the current policy got stuck on training cases."""
        rng = np.random.default_rng([self.config.seed, self.step, 1])
        chosen = rng.choice(len(self._train), min(self.config.online_cases, len(self._train)), replace=False)
        self._append_online(stuck_cases(Policy(self.network), [self._train[i] for i in chosen], seed=self.step))

    def _append_online(self, stuck: list[SolvedCase]) -> None:
        self._stuck += stuck
        solved = solve(self._stuck)
        if solved:
            self._online = Samples(solved)

    def _validate(self, loss: float) -> None:
        measures = summarise(evaluate(Policy(self.network), self._valid))
        reached = score(measures.alpha, measures.delta_ft)
        if reached > self.best:
            self.best = reached
            torch.save(self.network.state_dict(), self.folder / "best.pt")
        record = {"step": self.step, "loss": loss, "seconds": self.seconds, "online_cases": len(self._stuck)}
        record |= dataclasses.asdict(measures)
        with self._log.open("a") as log:
            log.write(json.dumps(record) + "\n")
        self._save()

    def _save(self) -> None:
        state = {
            "config": dataclasses.asdict(self.config),
            "step": self.step,
            "best": self.best,
            "seconds": self.seconds,
            "stuck": [(s.number, torch.from_numpy(s.case.starts)) for s in self._stuck],
            "network": self.network.state_dict(),
            "optimiser": self._optimiser.state_dict(),
        }
        draft = self._checkpoint.with_suffix(".draft")
        torch.save(state, draft)
        draft.replace(self._checkpoint)  # a run killed while it saves keeps the checkpoint before

    def _resume(self) -> None:
        state: dict[str, Any] = torch.load(self._checkpoint, weights_only=True)
        if state["config"] != dataclasses.asdict(self.config):
            raise ValueError(f"{self._checkpoint} is of a run with another configuration: choose another folder")
        self.step, self.best, self.seconds = state["step"], state["best"], state["seconds"]
        if self._log.exists():  # a run killed between log and checkpoint validates that step again
            lines = [line for line in self._log.read_text().splitlines() if json.loads(line)["step"] <= self.step]
            self._log.write_text("".join(f"{line}\n" for line in lines))
        # The expert is deterministic: kept are the states in which it was asked, not its answers.
        by_number = {s.number: s.case for s in self._train}
        nowhere = np.zeros((0, 0, 2), dtype=np.int64)
        self._append_online(
            [
                SolvedCase(number, dataclasses.replace(by_number[number], starts=starts.numpy()), nowhere)
                for number, starts in state["stuck"]
            ]
        )
        self.network.load_state_dict(state["network"])
        self._optimiser.load_state_dict(state["optimiser"])


def score(alpha: float, delta_ft: float) -> float:
    """What the best checkpoint has most of: success, and among equals the shorter flowtime."""
    return alpha - 0.1 * delta_ft
