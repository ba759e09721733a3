"""Training: it learns, and an interrupted run goes on as if nothing had happened."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from magat_robot.policy.config import PolicyConfig
from magat_training.cases import SolvedCase
from magat_training.samples import Batch, Samples
from magat_training.train import TrainConfig, Trainer

CONFIG = TrainConfig(
    policy=PolicyConfig("MAGAT-F-16", channels=(4, 4, 8), hidden=16),
    steps=12,
    batch=8,
    validate_every=4,
    online_from=3,
    online_every=3,
    online_cases=3,
    seed=5,
)
KEPT = {"checkpoint.pt", "best.pt", "log.jsonl"}


class PlugPulledError(Exception):
    """The end of a run that nobody planned."""


def trained(
    folder: Path, solved: list[SolvedCase], config: TrainConfig = CONFIG, stop_after: int | None = None
) -> Trainer:
    trainer = Trainer(config, folder, solved[:6], solved[6:])

    def on_step(step: int, loss: float) -> None:
        if step == stop_after:
            raise PlugPulledError

    if stop_after is None:
        trainer.run(on_step)
    else:
        with pytest.raises(PlugPulledError):
            trainer.run(on_step)
    return trainer


def weights(trainer: Trainer) -> dict[str, bytes]:
    return {name: tensor.numpy().tobytes() for name, tensor in trainer.network.state_dict().items()}


def records(folder: Path) -> list[dict]:
    return [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]


def without_times(log: list[dict]) -> str:
    return json.dumps([{key: value for key, value in record.items() if key != "seconds"} for record in log])


@pytest.mark.parametrize("stops", [(2,), (6,), (8, 11)], ids=["before a checkpoint", "after one", "twice"])
def test_an_interrupted_run_ends_with_the_bits_of_an_uninterrupted_one(
    tmp_path: Path, solved: list[SolvedCase], stops: tuple[int, ...]
) -> None:
    straight = trained(tmp_path / "straight", solved)
    for step in stops:
        trained(tmp_path / "broken", solved, stop_after=step)
    torch.manual_seed(999)
    resumed = Trainer(CONFIG, tmp_path / "broken", solved[:6], solved[6:])
    assert resumed.step == (stops[-1] - 1) // 4 * 4
    resumed.run()
    assert resumed.step == straight.step == 12
    assert weights(resumed) == weights(straight)
    assert resumed.best == straight.best
    best = [torch.load(tmp_path / name / "best.pt", weights_only=True) for name in ("straight", "broken")]
    assert all(torch.equal(tensor, best[1][name]) for name, tensor in best[0].items())
    assert without_times(records(tmp_path / "broken")) == without_times(records(tmp_path / "straight"))
    assert records(tmp_path / "broken")[-1]["online_cases"] > 0


def test_a_finished_run_is_not_trained_any_further(tmp_path: Path, solved: list[SolvedCase]) -> None:
    first = trained(tmp_path, solved)
    again = trained(tmp_path, solved)
    assert weights(again) == weights(first)
    assert len(records(tmp_path)) == 3


def test_another_seed_gives_another_network(tmp_path: Path, solved: list[SolvedCase]) -> None:
    runs = [
        trained(tmp_path / str(seed), solved, replace(CONFIG, seed=seed, steps=1, validate_every=1)) for seed in (1, 2)
    ]
    assert weights(runs[0]) != weights(runs[1])


def test_only_training_cases_are_trained_on(tmp_path: Path, solved: list[SolvedCase]) -> None:
    config = replace(CONFIG, steps=2, validate_every=2)
    splits = [(solved[:4], solved[6:]), (solved[:4], solved[4:]), (solved[2:6], solved[6:])]
    runs = []
    for number, (train, valid) in enumerate(splits):
        runs.append(Trainer(config, tmp_path / str(number), train, valid))
        runs[-1].run()
    assert weights(runs[0]) == weights(runs[1])
    assert weights(runs[0]) != weights(runs[2])


def test_every_step_of_every_run_sees_instants_of_its_own(
    tmp_path: Path, solved: list[SolvedCase], monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[bytes] = []

    def spy(self: Samples, rng: np.random.Generator, size: int, batch: Callable = Samples.batch) -> Batch:
        made = batch(self, rng, size)
        seen.append(made.view.tobytes())
        return made

    monkeypatch.setattr(Samples, "batch", spy)
    for seed in (1, 2):
        trained(tmp_path / str(seed), solved, replace(CONFIG, seed=seed, online_from=100))
    assert len(seen) == len(set(seen)) == 2 * CONFIG.steps


def test_the_online_expert_is_asked_from_its_first_step_on(tmp_path: Path, solved: list[SolvedCase]) -> None:
    counts = {}
    for name, first in (("early", 3), ("late", 6), ("never", 100)):
        trained(tmp_path / name, solved, replace(CONFIG, online_from=first, validate_every=3))
        counts[name] = [record["online_cases"] for record in records(tmp_path / name)]
    # Asked before the steps 4, 7 and 10; looked at after the steps 3, 6, 9 and 12.
    early, late = counts["early"], counts["late"]
    assert early[0] == 0 < early[1] <= 3
    assert early[1] < early[2] < early[3] <= 9
    assert late[:2] == [0, 0] != late[2:]
    assert counts["never"] == [0, 0, 0, 0]


@pytest.mark.parametrize(("share", "online"), [(0.0, 0), (0.25, 2), (1.0, 8)])
def test_a_share_of_each_batch_is_the_online_experts(
    tmp_path: Path, solved: list[SolvedCase], monkeypatch: pytest.MonkeyPatch, share: float, online: int
) -> None:
    sizes: list[tuple[bool, int]] = []
    first: list[Samples] = []

    def spy(self: Samples, rng: np.random.Generator, size: int, batch: Callable = Samples.batch) -> Batch:
        first.append(self)
        sizes.append((self is first[0], size))
        return batch(self, rng, size)

    monkeypatch.setattr(Samples, "batch", spy)
    trained(tmp_path, solved, replace(CONFIG, steps=5, validate_every=5, online_share=share))
    assert sizes[:3] == [(True, 8)] * 3
    assert sizes[3:] == ([(True, 8 - online)] + [(False, online)] * (online > 0)) * 2


def test_a_folder_of_another_run_is_refused(tmp_path: Path, solved: list[SolvedCase]) -> None:
    trained(tmp_path, solved, stop_after=5)
    before = (tmp_path / "checkpoint.pt").read_bytes()
    with pytest.raises(ValueError, match=r"checkpoint\.pt is of a run with another configuration"):
        Trainer(replace(CONFIG, first_rate=0.5), tmp_path, solved[:6], solved[6:])
    assert (tmp_path / "checkpoint.pt").read_bytes() == before


def test_the_loss_falls(tmp_path: Path, solved: list[SolvedCase]) -> None:
    config = replace(CONFIG, steps=100, batch=16, first_rate=3e-3, validate_every=100, online_from=100)
    losses: list[float] = []
    Trainer(config, tmp_path, solved[:3], solved[6:]).run(lambda _, loss: losses.append(loss))
    assert len(losses) == 100
    assert losses[0] == pytest.approx(np.log(5), abs=0.5)  # five primitives, and nothing learned
    assert np.mean(losses[-10:]) < 0.6 * np.mean(losses[:5])


def test_the_log_has_a_json_object_for_each_validation(tmp_path: Path, solved: list[SolvedCase]) -> None:
    losses: dict[int, float] = {}
    trainer = Trainer(replace(CONFIG, steps=10), tmp_path, solved[:6], solved[6:])
    trainer.run(losses.__setitem__)
    log = records(tmp_path)
    assert [record["step"] for record in log] == [4, 8, 10]
    assert [record["cases"] for record in log] == [2, 2, 2]
    means = [np.mean([losses[step] for step in steps]) for steps in (range(1, 5), range(5, 9), range(9, 11))]
    assert [record["loss"] for record in log] == pytest.approx(means)
    assert {"alpha", "alpha_interval", "alpha_strict", "delta_ft", "p_rg", "seconds"} <= set(log[0])
    assert 0 < log[0]["seconds"] < log[1]["seconds"] < log[2]["seconds"]


def test_the_best_weights_are_those_of_the_best_validation(tmp_path: Path, solved: list[SolvedCase]) -> None:
    snapshots: dict[int, dict] = {}
    trainer = Trainer(replace(CONFIG, steps=24), tmp_path, solved[:6], solved[6:])
    trainer.run(
        lambda step, _: snapshots.update({step: {n: t.clone() for n, t in trainer.network.state_dict().items()}})
    )
    scores = {record["step"]: record["alpha"] - 0.1 * record["delta_ft"] for record in records(tmp_path)}
    best_step = max(scores, key=lambda step: scores[step])
    best = torch.load(tmp_path / "best.pt", weights_only=True)
    assert trainer.best == pytest.approx(scores[best_step])
    assert len(set(scores.values())) > 1
    assert all(torch.equal(tensor, snapshots[best_step][name]) for name, tensor in best.items())
    loaded = trainer.best_network().state_dict()
    assert all(torch.equal(tensor, best[name]) for name, tensor in loaded.items())


def test_the_learning_rate_falls_along_a_cosine(tmp_path: Path, solved: list[SolvedCase]) -> None:
    trainer = Trainer(replace(CONFIG, first_rate=1e-2, last_rate=1e-4), tmp_path, solved[:6], solved[6:])
    rates: list[float] = []
    trainer.run(lambda *_: rates.append(trainer._optimiser.param_groups[0]["lr"]))
    expected = [1e-4 + (1e-2 - 1e-4) * (1 + np.cos(np.pi * step / 12)) / 2 for step in range(12)]
    assert rates == pytest.approx(expected)


def test_a_run_leaves_its_checkpoint_its_best_weights_and_its_log(tmp_path: Path, solved: list[SolvedCase]) -> None:
    trained(tmp_path, solved)
    assert {file.name for file in tmp_path.iterdir()} == KEPT
