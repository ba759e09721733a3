# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Training: it learns, and an interrupted run goes on as if nothing had happened."""

import json
import pickle
import re
import shutil
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from tensorboardX.proto.event_pb2 import Event, SessionLog

from magat_evaluation.cases import SolvedCase
from magat_robot.policy.config import PolicyConfig
from magat_training import trainer as trainer_module
from magat_training.checkpoint import read_checkpoint, write_checkpoint
from magat_training.online import CORRECTIONS, Correction
from magat_training.samples import Batch, Instants, Pool, Sampler
from magat_training.trainer import TrainConfig, Trainer
from magat_training.workers import Workers

#: The online expert is asked before the steps 5, 7, 9 and 11: at once after each checkpoint, too.
CONFIG = TrainConfig(
    policy=PolicyConfig("MAGAT-F-16", channels=(4, 4, 8), hidden=16),
    steps=12,
    batch=8,
    first_rate=1e-2,
    validate_every=4,
    online_from=3,
    online_every=2,
    online_cases=3,
    online_rounds=2,
    seed=5,
)
KEPT = {"checkpoint.pt", "best.pt", "log.jsonl", "tensorboard"}
ONLINE = pytest.mark.parametrize("online", ["states", "failures", "off"])


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


def curves(folder: Path) -> dict[str, list[tuple[int, float]]]:
    """What TensorBoard shows of a run, steps and values by name.

    It reads file by file, in the order of their names, each up to a record that is torn. Wherever a session starts,
    what came before with the same step or a later one is hidden.
    """
    shown: dict[str, list[tuple[int, float]]] = {}
    for file in sorted((folder / "tensorboard").iterdir()):
        for event in events(file.read_bytes()):
            if event.session_log.status == SessionLog.START:
                shown = {name: [point for point in curve if point[0] < event.step] for name, curve in shown.items()}
            for value in event.summary.value:
                shown.setdefault(value.tag, []).append((event.step, value.simple_value))
    return {name: curve for name, curve in shown.items() if curve}


def events(content: bytes) -> list[Event]:
    """Those in a file of records: length, its checksum, the event, its checksum."""
    found = []
    while len(content) >= 12:
        (length,) = struct.unpack("<Q", content[:8])
        if len(content) < length + 16:
            break
        found.append(Event.FromString(content[12 : 12 + length]))
        content = content[length + 16 :]
    return found


def check_same(broken: Trainer, straight: Trainer) -> None:
    """A run that was broken off has come to what another came to in one go."""
    assert broken.step == straight.step == straight.config.steps
    assert weights(broken) == weights(straight)
    assert broken.best == straight.best
    best = [read_checkpoint(trainer.folder / "best.pt") for trainer in (straight, broken)]
    assert all(torch.equal(tensor, best[1][name]) for name, tensor in best[0].items())
    assert without_times(records(broken.folder)) == without_times(records(straight.folder))
    drawn = [curves(trainer.folder) for trainer in (broken, straight)]
    for curve in drawn:
        del curve["seconds"]
    assert drawn[0] == drawn[1]
    assert [step for step, _ in drawn[0]["alpha"]] == [record["step"] for record in records(straight.folder)]
    assert {file.name for file in broken.folder.iterdir()} == KEPT


@pytest.fixture(scope="module")
def straight(tmp_path_factory: pytest.TempPathFactory, solved: list[SolvedCase]) -> Callable[[str], Trainer]:
    """Runs that nothing interrupted, one for each way to ask the online expert."""
    runs: dict[str, Trainer] = {}

    def run(online: str) -> Trainer:
        if online not in runs:
            runs[online] = trained(tmp_path_factory.mktemp(online), solved, replace(CONFIG, online=online))
        return runs[online]

    return run


@pytest.fixture
def corrections(monkeypatch: pytest.MonkeyPatch) -> list[Correction]:
    """All that the online expert says from now on."""
    said: list[Correction] = []

    def spy(correct: Callable) -> Callable:
        return lambda *arguments: said.append(correct(*arguments)) or said[-1]

    monkeypatch.setattr(trainer_module, "CORRECTIONS", {name: spy(correct) for name, correct in CORRECTIONS.items()})
    return said


@ONLINE
@pytest.mark.parametrize("stops", [(2,), (6,), (8, 11)], ids=["before a checkpoint", "after one", "twice"])
def test_an_interrupted_run_ends_with_the_bits_of_an_uninterrupted_one(
    tmp_path: Path, solved: list[SolvedCase], straight: Callable, stops: tuple[int, ...], online: str
) -> None:
    config = replace(CONFIG, online=online)
    for step in stops:
        trained(tmp_path, solved, config, stop_after=step)
    torch.manual_seed(999)
    resumed = Trainer(config, tmp_path, solved[:6], solved[6:])
    assert resumed.step == (stops[-1] - 1) // 4 * 4
    resumed.run()
    check_same(resumed, straight(online))
    assert (records(tmp_path)[-1]["online_instants"] > 0) == (online != "off")


#: Lives of a run, each killed at a moment that is drawn, after at least one more checkpoint. The interpreter that
#: starts them has imported everything, also what torch imports when it is first needed.
LIVES = """
import os, pickle, random, signal, sys, time
from pathlib import Path
import torch
from magat_training.trainer import Trainer

torch.set_num_threads(1)
folder = Path(sys.argv[1])
config, train, valid = pickle.loads(Path(sys.argv[2]).read_bytes())
Trainer(config, folder.with_name("nothing"), train, valid)
checkpoint = folder / "checkpoint.pt"
moments = random.Random(17)

def checkpoints():
    return checkpoint.stat().st_mtime_ns if checkpoint.exists() else 0

ends = []
for _ in range(int(sys.argv[3])):
    before = checkpoints()
    child = os.fork()
    if child == 0:
        Trainer(config, folder, train, valid).run()
        os._exit(0)
    while checkpoints() == before and not os.waitid(os.P_PID, child, os.WEXITED | os.WNOHANG | os.WNOWAIT):
        time.sleep(0.001)
    time.sleep(moments.uniform(0, 0.1))
    os.kill(child, signal.SIGKILL)
    ends.append(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
print(ends)
"""


def test_a_run_that_is_killed_again_and_again_ends_with_the_bits_of_another(
    tmp_path: Path, solved: list[SolvedCase]
) -> None:
    # It writes after every step, so that some of the moments lie within that.
    config = replace(CONFIG, validate_every=1, online_every=4)
    valid = [min(solved[6:], key=lambda s: s.t_max)]
    parts = tmp_path / "parts.pickle"
    parts.write_bytes(pickle.dumps((config, solved[:6], valid)))
    program = [sys.executable, "-c", LIVES, str(tmp_path / "killed"), str(parts), "5"]
    done = subprocess.run(program, capture_output=True, text=True, timeout=90, check=True)
    ends = json.loads(done.stdout)
    assert set(ends) <= {-9, 0}, done.stderr
    assert ends[:3] == [-9] * 3
    runs = [Trainer(config, tmp_path / name, solved[:6], valid) for name in ("killed", "straight")]
    assert runs[0].step >= 3
    for run in runs:
        run.run()
    for draft in (tmp_path / "killed").glob("*.draft"):
        draft.unlink()  # of what was never finished; the next one is written over it
    check_same(*runs)


def test_a_torn_log_does_not_keep_a_run_from_being_resumed(
    tmp_path: Path, solved: list[SolvedCase], straight: Callable
) -> None:
    trained(tmp_path, solved, stop_after=7)
    log = tmp_path / "log.jsonl"
    log.write_text(log.read_text() + json.dumps(records(tmp_path)[0] | {"step": 8})[:50])
    check_same(trained(tmp_path, solved), straight("states"))


def test_a_validation_that_the_checkpoint_does_not_know_is_done_and_shown_once(
    tmp_path: Path, solved: list[SolvedCase], straight: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    saved: list[int] = []

    def pulled(self: Trainer, save: Callable = Trainer._save) -> None:
        saved.append(self.step)
        if saved == [4, 8]:
            raise PlugPulledError
        save(self)

    monkeypatch.setattr(Trainer, "_save", pulled)
    with pytest.raises(PlugPulledError):
        trained(tmp_path, solved)
    assert [record["step"] for record in records(tmp_path)] == [step for step, _ in curves(tmp_path)["alpha"]] == [4, 8]
    for file in (tmp_path / "tensorboard").iterdir():
        # As if it had been a while ago: files are named by the second.
        file.rename(file.with_name(re.sub(r"tfevents\.\d+", "tfevents.1000000000", file.name)))
    again = Trainer(CONFIG, tmp_path, solved[:6], solved[6:])
    assert [record["step"] for record in records(tmp_path)] == [4]
    again.run()
    assert saved == [4, 8, 8, 12]
    check_same(again, straight("states"))


@pytest.mark.parametrize(("name", "number"), [("checkpoint", 2), ("best", 1)])
def test_a_run_that_is_killed_while_it_writes_a_file_goes_on(
    tmp_path: Path,
    solved: list[SolvedCase],
    straight: Callable,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    number: int,
) -> None:
    written: list[str] = []

    def tear(path: Path, content: bytes, write: Callable = Path.write_bytes) -> None:
        written.append(path.name.partition(".")[0])
        if written[-1] == name and written.count(name) == number:
            write(path, content[:1000])
            raise PlugPulledError
        write(path, content)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "write_bytes", tear)
        with pytest.raises(PlugPulledError):
            trained(tmp_path, solved)
    check_same(trained(tmp_path, solved), straight("states"))


def test_a_finished_run_is_not_trained_any_further(
    tmp_path: Path, solved: list[SolvedCase], straight: Callable
) -> None:
    first = straight("states")
    shutil.copytree(first.folder, tmp_path / "copy")
    again = trained(tmp_path / "copy", solved)
    assert weights(again) == weights(first)
    assert records(tmp_path / "copy") == records(first.folder)
    assert curves(tmp_path / "copy") == curves(first.folder)


def test_another_seed_gives_another_network(tmp_path: Path, solved: list[SolvedCase]) -> None:
    runs = [
        trained(tmp_path / str(seed), solved, replace(CONFIG, seed=seed, steps=1, validate_every=1)) for seed in (1, 2)
    ]
    assert weights(runs[0]) != weights(runs[1])


def test_only_training_cases_are_trained_on(tmp_path: Path, solved: list[SolvedCase]) -> None:
    config = replace(CONFIG, steps=4, online_from=2)
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

    def spy(self: Sampler, *arguments: object, batch: Callable = Sampler.batch) -> Batch:
        made = batch(self, *arguments)
        seen.append(made.view.tobytes())
        return made

    monkeypatch.setattr(Sampler, "batch", spy)
    for seed in (1, 2):
        trained(tmp_path / str(seed), solved, replace(CONFIG, seed=seed, online="off", validate_every=12))
    assert len(seen) == len(set(seen)) == 2 * CONFIG.steps


def test_the_online_expert_is_asked_from_its_first_step_on(tmp_path: Path, solved: list[SolvedCase]) -> None:
    counts = {}
    for name, first in (("early", 3), ("late", 6), ("never", 100)):
        config = replace(CONFIG, online_from=first, online_every=3, online_rounds=9, validate_every=3)
        trained(tmp_path / name, solved, config)
        counts[name] = [record["online_instants"] for record in records(tmp_path / name)]
        alphas = [record["online_alpha"] for record in records(tmp_path / name)]
        assert [alpha is not None for alpha in alphas] == [count > 0 for count in counts[name]]
        assert all(alpha in (None, 0, 1 / 3, 2 / 3, 1) for alpha in alphas)
    # Asked before the steps 4, 7 and 10; looked at after the steps 3, 6, 9 and 12.
    early, late = counts["early"], counts["late"]
    assert early[0] == 0 < early[1] < early[2] < early[3]
    assert late[:2] == [0, 0] != late[2:]
    assert counts["never"] == [0, 0, 0, 0]


def test_the_online_expert_is_asked_about_training_cases_that_differ_from_round_to_round(
    tmp_path: Path, solved: list[SolvedCase], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[int, list[int]]] = []

    def spy(policy: object, cases: Sequence[SolvedCase], chosen: Sequence[int], seed: int) -> Correction:
        assert [case.number for case in cases] == [case.number for case in solved[:6]]
        asked.append((seed, list(chosen)))
        return CORRECTIONS["states"](policy, cases, chosen, seed)

    monkeypatch.setattr(trainer_module, "CORRECTIONS", {"states": spy})
    for seed in (5, 6):
        trained(tmp_path / str(seed), solved, replace(CONFIG, seed=seed, validate_every=12))
    assert all(len(set(chosen)) == 3 and set(chosen) <= set(range(6)) for _, chosen in asked)
    assert [step for step, _ in asked] == [4, 6, 8, 10] * 2  # an episode's randomness is not that of the round before
    rounds = [chosen for _, chosen in asked]
    assert rounds[:4] != rounds[4:]
    assert len({tuple(chosen) for chosen in rounds[:4]}) > 1


def test_the_online_expert_learns_of_the_policy_as_it_is(
    tmp_path: Path, solved: list[SolvedCase], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[np.ndarray] = []

    def spy(policy: object, *arguments: object) -> Correction:
        asked.append(policy._network.action.bias.numpy().copy())
        now.append(trainer.network.action.bias.detach().numpy().copy())
        return CORRECTIONS["states"](policy, *arguments)

    now: list[np.ndarray] = []
    monkeypatch.setattr(trainer_module, "CORRECTIONS", {"states": spy})
    trainer = Trainer(CONFIG, tmp_path, solved[:6], solved[6:])
    trainer.run()
    assert len({bias.tobytes() for bias in now}) == 4
    for policy, network in zip(asked, now, strict=True):
        assert np.abs(policy - network).max() < 1e-3 < np.abs(policy).max()  # on its grid


@pytest.mark.parametrize(("online", "kept"), [("states", slice(-2, None)), ("failures", slice(None))])
def test_corrections_of_old_states_are_dropped_and_those_of_failures_are_kept(
    tmp_path: Path, solved: list[SolvedCase], corrections: list[Correction], online: str, kept: slice
) -> None:
    config = replace(CONFIG, online=online, validate_every=2)
    trainer = Trainer(config, tmp_path, solved[:6], solved[6:])
    counts = [0] * 2
    expected = None

    def on_step(step: int, loss: float) -> None:
        nonlocal counts, expected
        said = [one.instants for one in corrections if one.instants is not None]
        assert len(said) == len(corrections) == max(0, (step - 3) // 2)
        if said:
            expected = Instants.join(said[kept])
            counts += [len(expected)] * (step % 2 == 0)
            assert trainer._online is not None
            now = trainer._online.instants
            assert all(np.array_equal(array, getattr(now, name)) for name, array in vars(expected).items())

    trainer.run(on_step)
    assert [record["online_instants"] for record in records(tmp_path)] == counts
    # What is known after the fourth round survives an interruption.
    resumed = Trainer(config, tmp_path, solved[:6], solved[6:])._online
    assert expected is not None
    assert resumed is not None
    assert all(np.array_equal(array, getattr(resumed.instants, name)) for name, array in vars(expected).items())


def test_without_an_online_expert_nobody_is_asked(
    tmp_path: Path, solved: list[SolvedCase], corrections: list[Correction]
) -> None:
    trainer = trained(tmp_path, solved, replace(CONFIG, online="off", online_from=0))
    assert corrections == []
    assert [record["online_instants"] for record in records(tmp_path)] == [0, 0, 0]
    assert [record["online_alpha"] for record in records(tmp_path)] == [None] * 3
    assert "online_alpha" not in curves(tmp_path)
    assert "online expert" not in trainer.spent


def test_an_online_expert_with_nothing_to_say_changes_nothing(
    tmp_path: Path, solved: list[SolvedCase], straight: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    def silent(*arguments: object) -> Correction:
        return Correction(None, CORRECTIONS["failures"](*arguments).episodes)

    monkeypatch.setattr(trainer_module, "CORRECTIONS", {"failures": silent})
    trainer = trained(tmp_path, solved, replace(CONFIG, online="failures"))
    assert weights(trainer) == weights(straight("off"))
    assert [record["online_instants"] for record in records(tmp_path)] == [0, 0, 0]
    assert [record["online_alpha"] is None for record in records(tmp_path)] == [True, False, False]


@pytest.mark.parametrize(("share", "online"), [(0.0, 0), (0.25, 2), (0.75, 6), (1.0, 8)])
def test_a_share_of_each_batch_is_the_online_experts(
    tmp_path: Path, solved: list[SolvedCase], monkeypatch: pytest.MonkeyPatch, share: float, online: int
) -> None:
    sizes: list[list[tuple[bool, int]]] = []

    def spy(
        self: Sampler, rng: np.random.Generator, shares: Sequence[tuple[Pool, int]], batch: Callable = Sampler.batch
    ) -> Batch:
        sizes.append([(pool is trainer._online, size) for pool, size in shares])
        assert all(pool is trainer._expert for pool, _ in shares[:1])
        return batch(self, rng, shares)

    monkeypatch.setattr(Sampler, "batch", spy)
    config = replace(CONFIG, steps=6, validate_every=6, online_share=share)
    trainer = Trainer(config, tmp_path, solved[:6], solved[6:])
    trainer.run()
    assert sizes == [[(False, 8)]] * 4 + [[(False, 8 - online), (True, online)]] * 2


def test_a_folder_of_another_run_is_refused(tmp_path: Path, solved: list[SolvedCase]) -> None:
    trained(tmp_path, solved, stop_after=5)
    before = (tmp_path / "checkpoint.pt").read_bytes()
    with pytest.raises(ValueError, match=r"checkpoint\.pt belongs to a run with another configuration"):
        Trainer(replace(CONFIG, first_rate=0.5), tmp_path, solved[:6], solved[6:])
    assert (tmp_path / "checkpoint.pt").read_bytes() == before


def test_a_run_of_another_number_of_processes_is_refused(tmp_path: Path, solved: list[SolvedCase]) -> None:
    trained(tmp_path, solved, stop_after=5)
    state = read_checkpoint(tmp_path / "checkpoint.pt")
    assert state["workers"] == 1
    write_checkpoint(tmp_path / "checkpoint.pt", state | {"workers": 2})
    before = (tmp_path / "log.jsonl").read_text()
    with pytest.raises(ValueError, match=r"checkpoint\.pt belongs to a run of 2 processes, not 1: start 2"):
        Trainer(CONFIG, tmp_path, solved[:6], solved[6:])
    assert (tmp_path / "log.jsonl").read_text() == before


def test_what_processes_cannot_share_is_refused(tmp_path: Path, solved: list[SolvedCase]) -> None:
    three = Workers(0, 3, torch.device("cpu"))
    with pytest.raises(ValueError, match="a batch of 8 instants cannot be divided among 3 processes"):
        Trainer(CONFIG, tmp_path / "new", solved[:6], solved[6:], three)
    # Each process runs episodes of its own.
    for config, train in ((replace(CONFIG, online_cases=2), solved[:6]), (CONFIG, solved[:2])):
        with pytest.raises(ValueError, match="the online expert needs at least 3 cases"):
            Trainer(replace(config, batch=9), tmp_path / "new", train, solved[6:], three)
    assert not (tmp_path / "new").exists()


def test_an_unknown_online_expert_is_refused() -> None:
    for wrong in ("no", "", "State"):
        with pytest.raises(ValueError, match=rf"unknown online expert '{wrong}': .*'off', 'failures', 'states'"):
            TrainConfig(online=wrong)


def test_without_cases_there_is_nothing_to_train_on(tmp_path: Path, solved: list[SolvedCase]) -> None:
    with pytest.raises(ValueError, match="nothing to learn from"):
        Trainer(CONFIG, tmp_path, [], solved)


def test_the_loss_falls(tmp_path: Path, solved: list[SolvedCase]) -> None:
    config = replace(CONFIG, steps=100, batch=16, first_rate=3e-3, validate_every=100, online="off")
    losses: list[float] = []
    Trainer(config, tmp_path, solved[:3], solved[6:]).run(lambda _, loss: losses.append(loss))
    assert len(losses) == 100
    assert losses[0] == pytest.approx(np.log(5), abs=0.5)  # five primitives, and nothing learned
    assert np.mean(losses[-10:]) < 0.7 * np.mean(losses[:5])


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


def test_tensorboard_shows_what_is_in_the_log(straight: Callable) -> None:
    run = straight("states")
    log = records(run.folder)
    drawn = curves(run.folder)
    assert set(drawn) == {
        "alpha", "delta_ft", "loss", "moves_blocked", "online_alpha", "p_rg", "rate", "seconds"
    }  # fmt: skip
    for name in set(drawn) - {"rate"}:
        expected = [(record["step"], record[name]) for record in log if record[name] is not None]
        assert np.array(drawn[name]) == pytest.approx(np.array(expected))
    assert [step for step, _ in drawn["online_alpha"]] == [8, 12]
    rates = [(CONFIG.first_rate - CONFIG.last_rate) * (1 + np.cos(np.pi * step / 12)) / 2 for step in (3, 7, 11)]
    assert [rate for _, rate in drawn["rate"]] == pytest.approx(np.array(rates) + CONFIG.last_rate)


def test_a_run_knows_what_its_time_was_spent_on(tmp_path: Path, solved: list[SolvedCase]) -> None:
    trained(tmp_path, solved, stop_after=9)
    started = time.monotonic()
    trainer = Trainer(CONFIG, tmp_path, solved[:6], solved[6:])
    assert trainer.spent == {}
    trainer.run()
    taken = time.monotonic() - started
    parts = {"online expert", "sampling", "forward", "backward", "optimiser", "validation"}
    assert set(trainer.spent) == parts
    assert all(seconds > 0 for seconds in trainer.spent.values())
    assert sum(trainer.spent.values()) <= taken
    # What the log counts goes on from before, and leaves out the validations.
    before, after = (record["seconds"] for record in records(tmp_path)[1:])
    learning = sum(seconds for part, seconds in trainer.spent.items() if part != "validation")
    assert learning <= after - before <= taken


def test_the_best_weights_are_those_of_the_best_validation(tmp_path: Path, solved: list[SolvedCase]) -> None:
    snapshots: dict[int, dict] = {}
    trainer = Trainer(replace(CONFIG, steps=16, online="off", seed=1), tmp_path, solved[:6], solved[6:])
    trainer.run(
        lambda step, _: snapshots.update({step: {n: t.clone() for n, t in trainer.network.state_dict().items()}})
    )
    scores = {record["step"]: record["alpha"] - record["delta_ft"] for record in records(tmp_path)}
    best_step = max(scores, key=lambda step: scores[step])
    best = read_checkpoint(tmp_path / "best.pt")
    assert trainer.best == pytest.approx(scores[best_step])
    assert len(set(scores.values())) > 1
    assert all(torch.equal(tensor, snapshots[best_step][name]) for name, tensor in best.items())
    loaded = trainer.best_network().state_dict()
    assert all(torch.equal(tensor, best[name]) for name, tensor in loaded.items())


def test_the_learning_rate_falls_along_a_cosine(tmp_path: Path, solved: list[SolvedCase]) -> None:
    config = replace(CONFIG, last_rate=1e-4, online="off", validate_every=12)
    trainer = Trainer(config, tmp_path, solved[:6], solved[6:])
    rates: list[float] = []
    trainer.run(lambda *_: rates.append(trainer._optimiser.param_groups[0]["lr"]))
    expected = [1e-4 + (1e-2 - 1e-4) * (1 + np.cos(np.pi * step / 12)) / 2 for step in range(12)]
    assert rates == pytest.approx(expected)


def test_a_run_leaves_its_checkpoint_its_best_weights_and_its_log(straight: Callable) -> None:
    assert {file.name for file in straight("states").folder.iterdir()} == KEPT
