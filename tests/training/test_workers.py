# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Processes that train one policy together: all of them have the same weights, and one writes."""

import json
import os
import pickle
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch.nn.functional import cross_entropy

from magat_evaluation.cases import SolvedCase
from magat_robot.policy.config import PolicyConfig
from magat_robot.policy.network import PolicyNetwork
from magat_training.trainer import TrainConfig, Trainer
from magat_training.workers import ALONE, Workers

#: Three, not two: two numbers give the same sum in any order.
COUNT = 3
#: The online expert is asked at once after each checkpoint.
CONFIG = TrainConfig(
    policy=PolicyConfig("MAGAT-F-16", channels=(4, 4, 8), hidden=16),
    steps=8,
    batch=12,
    first_rate=1e-2,
    validate_every=4,
    online_from=2,
    online_every=2,
    online_cases=5,
    online_rounds=2,
    seed=5,
)

#: What each process does, all of them forks of one that has imported everything. They find each other as those of
#: torchrun do. Each leaves what it has found out.
PROGRAM = f"""
import dataclasses, os, pickle, signal, socket, sys, time
from pathlib import Path
import torch
from magat_training.online import CORRECTIONS
from magat_training.samples import Sampler
from magat_training.trainer import Trainer
from magat_training.workers import Workers

signal.alarm(80)  # nobody waits for ever
torch.set_num_threads(1)
folder = Path(sys.argv[1])
config, train, valid = pickle.loads((folder / "parts.pickle").read_bytes())
off = dataclasses.replace(config, online="off")
Trainer(config, folder / "nothing", train, valid)  # torch imports some of its parts when they are first needed

def weights(trainer):
    return [tensor.detach().clone() for tensor in trainer.network.parameters()]

class PlugPulledError(Exception):
    pass

def pull(step, loss):
    if step == 7:
        raise PlugPulledError

def run():
    workers = Workers.join("cpu")
    rank = workers.rank
    found = {{"rank": rank, "first": workers.first, "share": workers.share(list(range(8)))}}
    found["everyones"] = workers.everyones({{"rank": rank, "said": "x" * rank}})
    if workers.first:
        time.sleep(0.3)
        (folder / "late").touch()
    workers.wait()
    found["waited"] = (folder / "late").exists()

    # Only the last one's episodes succeed.
    def correct(*arguments, correct=CORRECTIONS["states"]):
        correction = correct(*arguments)
        episodes = [dataclasses.replace(episode, success=rank == {COUNT - 1}) for episode in correction.episodes]
        return dataclasses.replace(correction, episodes=episodes)
    CORRECTIONS["states"] = correct

    # A run, each process with a folder of its own, so that it shows which of them writes.
    trainer = Trainer(config, folder / f"straight{{rank}}", train, valid, workers)
    trainer.run()
    found["straight"] = weights(trainer)
    found["buffers"] = list(trainer.network.buffers())
    found["corrections"] = [(one.case.tolist(), one.now.tolist()) for one in trainer._corrections]
    found["online_alpha"] = trainer._online_alpha

    # The same, interrupted.
    try:
        Trainer(config, folder / "broken", train, valid, workers).run(pull)
    except PlugPulledError:
        pass
    trainer = Trainer(config, folder / "broken", train, valid, workers)
    found["resumed_at"] = trainer.step
    trainer.run()
    found["resumed"] = weights(trainer)

    # One step: from which weights, on what, with which gradients.
    trainer = Trainer(off, folder / "one", train, valid, workers)
    found["before"] = {{name: tensor.clone() for name, tensor in trainer.network.state_dict().items()}}
    batches, draw = [], Sampler.batch
    Sampler.batch = lambda *arguments: batches.append(draw(*arguments)) or batches[-1]
    trainer.train_step()
    found["batch"] = vars(batches[0])
    found["gradients"] = [parameter.grad.clone() for parameter in trainer.network.parameters()]

    # Robots that do not talk leave some of the weights without a gradient.
    silent = dataclasses.replace(off, policy=dataclasses.replace(config.policy, taps=1), steps=3)
    trainer = Trainer(silent, folder / "silent", train, valid, workers)
    trainer.run()
    found["silent"] = weights(trainer)
    found["whole"] = (folder / "silent" / "checkpoint.pt").exists()

    (folder / f"found{{rank}}.pickle").write_bytes(pickle.dumps(found))
    workers.leave()

with socket.socket() as free:
    free.bind(("127.0.0.1", 0))
    port = free.getsockname()[1]
os.environ |= {{"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(port), "WORLD_SIZE": "{COUNT}"}}
children = []
for rank in range({COUNT}):
    os.environ |= {{"RANK": str(rank), "LOCAL_RANK": str(rank)}}
    children.append(os.fork())
    if children[-1] == 0:
        signal.alarm(80)
        run()
        sys.stdout.flush()
        os._exit(0)
for _ in children:
    child, status = os.wait()
    if status:  # the others would wait for it
        for other in children:
            if other != child:
                os.kill(other, signal.SIGKILL)
        sys.exit(f"a process ended with {{os.waitstatus_to_exitcode(status)}}")
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, solved: list[SolvedCase]) -> Path:
    """Where processes have trained together."""
    folder = tmp_path_factory.mktemp("together")
    (folder / "parts.pickle").write_bytes(pickle.dumps((CONFIG, solved[:6], solved[6:])))
    # Gloo asks the machine for its address otherwise, and not all machines know one.
    environment = os.environ | {"GLOO_SOCKET_IFNAME": "lo"}
    program = [sys.executable, "-c", PROGRAM, str(folder)]
    with subprocess.Popen(
        program, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    ) as process:
        try:
            output, _ = process.communicate(timeout=90)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            output, _ = process.communicate()
            pytest.fail(f"the processes hang:\n{output}")
    assert process.returncode == 0, output
    return folder


@pytest.fixture(scope="module")
def found(folder: Path) -> list[dict[str, Any]]:
    """What each process has found out."""
    return [pickle.loads((folder / f"found{rank}.pickle").read_bytes()) for rank in range(COUNT)]


def same(ones: list[torch.Tensor], others: list[torch.Tensor]) -> bool:
    return all(torch.equal(one, other) for one, other in zip(ones, others, strict=True))


def records(folder: Path) -> list[dict]:
    log = [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
    return [record | {"seconds": None} for record in log]


def test_each_knows_its_place(found: list[dict[str, Any]]) -> None:
    assert [one["rank"] for one in found] == [0, 1, 2]
    assert [one["first"] for one in found] == [True, False, False]


def test_shares_are_parts_of_the_whole(found: list[dict[str, Any]]) -> None:
    assert [one["share"] for one in found] == [[0, 3, 6], [1, 4, 7], [2, 5]]


def test_everyones_items_come_to_all_in_order(found: list[dict[str, Any]]) -> None:
    expected = [{"rank": 0, "said": ""}, {"rank": 1, "said": "x"}, {"rank": 2, "said": "xx"}]
    assert [one["everyones"] for one in found] == [expected] * 3


def test_nobody_goes_on_before_the_last_is_there(found: list[dict[str, Any]]) -> None:
    assert all(one["waited"] for one in found)


def test_all_end_with_the_same_weights(tmp_path: Path, solved: list[SolvedCase], found: list[dict[str, Any]]) -> None:
    assert same(found[0]["straight"], found[1]["straight"])
    assert same(found[0]["straight"], found[2]["straight"])
    alone = Trainer(CONFIG, tmp_path, solved[:6], solved[6:])
    alone.run()
    assert not same(found[0]["straight"], list(alone.network.parameters()))


def test_only_the_first_writes(folder: Path) -> None:
    files = [sorted(file.name for file in (folder / f"straight{rank}").iterdir()) for rank in range(COUNT)]
    assert files == [["best.pt", "checkpoint.pt", "log.jsonl", "tensorboard"], [], []]


def test_an_interrupted_run_of_several_ends_with_the_bits_of_an_uninterrupted_one(
    folder: Path, found: list[dict[str, Any]]
) -> None:
    assert all(one["resumed_at"] == 4 for one in found)
    for one in found:
        assert same(one["resumed"], found[0]["straight"])
    states = [torch.load(folder / name / "checkpoint.pt", weights_only=True) for name in ("straight0", "broken")]
    # With the statistics of the first one.
    assert same(*(list(state["network"].values()) for state in states))
    assert records(folder / "broken") == records(folder / "straight0")


def test_what_the_online_expert_says_to_one_is_said_to_all(found: list[dict[str, Any]]) -> None:
    assert [one["corrections"] for one in found] == [found[0]["corrections"]] * COUNT
    assert [one["online_alpha"] for one in found] == [1 / CONFIG.online_cases] * COUNT
    # The corrections of two rounds, and in each round every case once.
    cases = [set(case) for case, _ in found[0]["corrections"]]
    assert len(cases) == 2 * COUNT
    for parts in (cases[:COUNT], cases[COUNT:]):
        assert sorted(map(len, parts)) == [1, 2, 2]
        assert len(set.union(*parts)) == CONFIG.online_cases


def test_gradients_are_the_mean_over_all_processes(found: list[dict[str, Any]]) -> None:
    batches = [one["batch"] for one in found]
    assert [len(batch["action"]) for batch in batches] == [CONFIG.batch // COUNT * 5] * COUNT
    assert len({batch["view"].tobytes() for batch in batches}) == COUNT
    own = []
    for batch in batches:
        # Each normalises by its own part of the batch.
        network = PolicyNetwork(CONFIG.policy)
        network.load_state_dict(found[0]["before"])
        heard, action = torch.from_numpy(batch["heard"]), torch.from_numpy(batch["action"])
        cross_entropy(network.train()(torch.from_numpy(batch["view"]).float(), heard), action).backward()
        own.append([parameter.grad for parameter in network.parameters()])
    for number, together in enumerate(found[0]["gradients"]):
        mean = np.mean([part[number].numpy() for part in own], axis=0)
        assert together.numpy() == pytest.approx(mean, rel=1e-3, abs=1e-6)
    for one, part in zip(found, own, strict=True):
        assert same(one["gradients"], found[0]["gradients"])
        apart = [(a - b).abs().max() > 1e-3 for a, b in zip(part, found[0]["gradients"], strict=True)]
        assert any(apart)


def test_a_team_that_does_not_talk_is_trained_together_too(found: list[dict[str, Any]]) -> None:
    for one in found:
        assert same(one["silent"], found[0]["silent"])


def test_a_run_is_over_for_all_when_the_first_has_written_its_files(found: list[dict[str, Any]]) -> None:
    assert all(one["whole"] for one in found)


def test_a_process_alone_is_everyone(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("RANK", "WORLD_SIZE", "LOCAL_RANK"):
        monkeypatch.delenv(name, raising=False)
    workers = Workers.join("cpu")
    assert workers == ALONE == Workers(0, 1, torch.device("cpu"))
    assert workers.first
    assert workers.share([3, 1, 2]) == [3, 1, 2]
    said = {"any": "thing"}
    assert workers.everyones(said) == [said]
    network = torch.nn.BatchNorm2d(2)
    assert workers.wrap(network) is network
    # There is nobody to wait for, to hear or to leave.
    workers.share_statistics(network)
    workers.wait()
    workers.leave()


def test_a_place_is_that_which_torchrun_gives(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[tuple] = []
    monkeypatch.setattr(torch.distributed, "init_process_group", lambda *given, **named: started.append((given, named)))
    for name, value in (("RANK", "5"), ("WORLD_SIZE", "8"), ("LOCAL_RANK", "1")):
        monkeypatch.setenv(name, value)
    assert Workers.join("cpu") == Workers(5, 8, torch.device("cpu"))
    assert started == [(("gloo",), {"rank": 5, "world_size": 8})]
