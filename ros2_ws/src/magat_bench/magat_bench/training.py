# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""``magat bench-training``: observations per second in training, the time of each part, and the limit of the CPU.

Times are CPU times of this process, and recipes take turns: other load on the machine hardly changes their ratio.
"""

import dataclasses
import math
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from rich.console import Console, Group
from rich.table import Table
from torch.profiler import ProfilerActivity, profile
from torch.utils.flop_counter import FlopCounterMode

from magat_evaluation.cases import SolvedCase, solved_cases
from magat_evaluation.splits import SPLITS
from magat_node.progress import progress_bars, tracked
from magat_robot.policy.config import ModelError
from magat_robot.policy.models import find_policy
from magat_robot.policy.store import load_network
from magat_training.trainer import TrainConfig, Trainer

#: Steps before the timing begins.
WARM_UP = 10
#: Steps of one recipe before the next one has its turn.
TURN = 10
#: The parts of a step.
PARTS = ("sampling", "forward", "backward", "optimiser")
#: Names of operators in the table, by a part of torch's name; the first match counts.
_KINDS = (
    ("convolution", "convolutions"),
    ("batch_norm", "batch normalisation"),
    ("hardtanh", "activations"),
    ("clamp", "activations"),
    ("mm", "matrix products"),
    ("max_pool", "pooling"),
)


@dataclass(frozen=True)
class TrainingBench:
    """What `bench_training` measured."""

    config: TrainConfig
    threads: int
    #: Robots in an instant.
    robots: int
    #: Seconds of each part of one step.
    parts: dict[str, float]
    #: Seconds of one round of the online expert, and of one validation.
    online: float
    validation: float
    #: Shares of forward and backward, by kind of operator.
    operators: dict[str, float]
    #: Floating-point operations of forward and backward for one observation.
    flops: float
    #: Floating-point operations per second in a product of large matrices, the limit of the CPU.
    peak: float

    @property
    def step(self) -> float:
        """Seconds of a step."""
        return sum(self.parts.values())

    @property
    def run(self) -> dict[str, float]:
        """Seconds of each part of a whole training run."""
        config = self.config
        first = math.ceil(config.online_from / config.online_every) * config.online_every
        rounds = 0 if config.online == "off" else len(range(first, config.steps, config.online_every))
        return {name: seconds * config.steps for name, seconds in self.parts.items()} | {
            "online expert": rounds * self.online,
            "validation": config.steps // config.validate_every * self.validation,
        }

    @property
    def rate(self) -> float:
        """Observations per second in steps."""
        return self.config.batch * self.robots / self.step

    @property
    def run_rate(self) -> float:
        """Observations per second in a whole run."""
        return self.config.batch * self.robots * self.config.steps / sum(self.run.values())


def bench_training(
    configs: Sequence[TrainConfig], threads: int, steps: int, cases: int, console: Console
) -> list[TrainingBench]:
    """Train by each recipe for some steps, in turns, with one round of the online expert and one validation.

    A training starts from the weights in models/, if there are any of this recipe's policy: an untrained policy fails
    more often, and its episodes take longer than those in most of a training.

    Args:
        configs: the recipes.
        threads: for torch.
        steps: number of timed steps.
        cases: number of training cases, drawn and solved first, and the most validation cases.
        console: shows the progress.

    Returns:
        The measures of each recipe.
    """
    torch.set_num_threads(threads)
    train, valid = (
        list(tracked(solved_cases(numbers), what, len(numbers), console))
        for what, numbers in (
            ("training cases", SPLITS["train"][:cases]),
            ("validation cases", SPLITS["valid"][: min(max(config.valid_cases for config in configs), cases)]),
        )
    )
    last = WARM_UP + steps
    with tempfile.TemporaryDirectory() as folder, progress_bars(console) as progress:
        task = progress.add_task("training", total=last * len(configs))
        trainers = []
        for number, config in enumerate(configs):
            once = dataclasses.replace(config, steps=last, online_from=0, online_every=last, validate_every=last)
            own = Path(folder) / str(number)
            trainers.append(Trainer(once, own, train, valid[: config.valid_cases], clock=time.process_time))
            _take_weights(trainers[-1])
        before: list[dict[str, float]] = []
        for until in [WARM_UP, *range(WARM_UP + TURN, last, TURN), last]:
            for trainer in trainers:
                trainer.run(lambda *_: progress.advance(task), until)
            before = before or [dict(trainer.spent) for trainer in trainers]
    peak = _peak()
    return [
        _bench(config, threads, steps, trainer.spent, start, train, peak)
        for config, trainer, start in zip(configs, trainers, before, strict=True)
    ]


def _bench(
    config: TrainConfig,
    threads: int,
    steps: int,
    spent: dict[str, float],
    before: dict[str, float],
    train: list[SolvedCase],
    peak: float,
) -> TrainingBench:
    """The measures of ``config`` from the seconds ``spent`` on each part, those of the warm-up ``before`` included."""
    plain = dataclasses.replace(config, online="off")
    robots = train[0].case.robots
    return TrainingBench(
        config,
        threads,
        robots,
        {part: (spent[part] - before[part]) / steps for part in PARTS},
        spent.get("online expert", 0.0),
        spent["validation"],
        _operators(dataclasses.replace(plain, steps=5), train),
        _flops(dataclasses.replace(plain, steps=1), train) / (config.batch * robots),
        peak,
    )


def table(bench: TrainingBench) -> Group:
    """``bench`` for the terminal."""
    policy = bench.config.policy
    title = f"{policy.name}, CNN {policy.cnn} {policy.channels}, {bench.threads} thread(s), CPU time"
    whole = Table(title=title, title_justify="left")
    for heading in ("part", "ms per step", "share of a step", "share of a run"):
        whole.add_column(heading, justify="left" if heading == "part" else "right", overflow="fold")
    total = sum(bench.run.values())
    for part, seconds in bench.run.items():
        own = bench.parts.get(part)
        shown = ("", "") if own is None else (f"{1e3 * own:.1f}", f"{own / bench.step:.1%}")
        whole.add_row(part, *shown, f"{seconds / total:.1%}")
    operators = Table(title="Forward and backward, by operators", title_justify="left")
    operators.add_column("operators", overflow="fold")
    operators.add_column("share", justify="right", overflow="fold")
    for kind, share in bench.operators.items():
        operators.add_row(kind, f"{share:.1%}")
    reached = bench.flops * bench.config.batch * bench.robots / (bench.parts["forward"] + bench.parts["backward"])
    return Group(
        whole,
        operators,
        f"{bench.rate:,.0f} observations per second in steps, {bench.run_rate:,.0f} over a run of "
        f"{bench.config.steps} steps with its online expert and validations ({total / 60:.0f} minutes).",
        f"Forward and backward: {bench.flops / 1e6:.1f} million floating-point operations per observation, "
        f"{reached / 1e9:.0f} billion per second; a product of large matrices reaches {bench.peak / 1e9:.0f}: "
        f"{reached / bench.peak:.0%}. The limit is {bench.peak / bench.flops:,.0f} observations per second.",
    )


def _take_weights(trainer: Trainer) -> None:
    try:
        network, _ = load_network(find_policy(trainer.config.policy.name))
    except ModelError:
        return  # not trained yet
    if network.config == dataclasses.replace(trainer.config.policy, temperature=network.config.temperature):
        trainer.network.load_state_dict(network.state_dict())


def _operators(config: TrainConfig, train: list[SolvedCase]) -> dict[str, float]:
    """Shares of the CPU time in forward and backward by kind of operator, the largest first."""
    with tempfile.TemporaryDirectory() as folder, profile(activities=[ProfilerActivity.CPU]) as profiler:
        trainer = Trainer(config, Path(folder), train, train[:1])
        trainer.run()
    spent: dict[str, float] = {}
    for event in profiler.key_averages():
        kind = next((kind for part, kind in _KINDS if part in event.key), "other")
        spent[kind] = spent.get(kind, 0.0) + event.self_cpu_time_total
    total = sum(spent.values())
    return {kind: spent[kind] / total for kind in sorted(spent, key=lambda kind: -spent[kind])}


def _flops(config: TrainConfig, train: list[SolvedCase]) -> float:
    """Floating-point operations of forward and backward in one step, as torch counts them."""
    with tempfile.TemporaryDirectory() as folder:
        trainer = Trainer(config, Path(folder), train, train[:1])
        with FlopCounterMode(display=False) as counter:
            trainer.train_step()
        return float(counter.get_total_flops())


def _peak(size: int = 1536, repetitions: int = 8) -> float:
    """Floating-point operations per second in a product of float32 matrices, the best of ``repetitions``."""
    left, right = torch.rand(size, size), torch.rand(size, size)
    best = 0.0
    for _ in range(repetitions):
        started = time.process_time()
        torch.mm(left, right)
        best = max(best, 2 * size**3 / (time.process_time() - started))
    return best
