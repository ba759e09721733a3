# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a training finds in its folder after it was killed, damaged, or out of space."""

import errno
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from magat_evaluation.cases import SolvedCase
from magat_robot.policy.config import PolicyConfig
from magat_training.checkpoint import CheckpointError, read_checkpoint, write_checkpoint
from magat_training.trainer import TrainConfig, Trainer

CONFIG = TrainConfig(
    policy=PolicyConfig("GNN-F-4", channels=(2, 2, 4), hidden=8),
    steps=2,
    batch=4,
    validate_every=2,
    online="off",
)
STATE = {"step": 3, "weights": torch.arange(5.0)}


def test_a_state_survives(tmp_path: Path) -> None:
    write_checkpoint(tmp_path / "state.pt", STATE)
    found = read_checkpoint(tmp_path / "state.pt")
    assert found["step"] == 3
    assert torch.equal(found["weights"], STATE["weights"])
    assert [file.name for file in tmp_path.iterdir()] == ["state.pt"]


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: content[:-1],
        lambda content: content[: len(content) // 2],
        lambda content: b"",
        lambda content: content[:100] + bytes([content[100] ^ 1]) + content[101:],
        lambda content: content[:-1] + bytes([content[-1] ^ 128]),
    ],
    ids=["one byte less", "half", "empty", "another bit", "another hash"],
)
def test_damage_is_found_and_named(tmp_path: Path, damage: Callable[[bytes], bytes]) -> None:
    path = tmp_path / "state.pt"
    write_checkpoint(path, STATE)
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(CheckpointError, match=r"state\.pt is damaged, or of an older version: delete its folder"):
        read_checkpoint(path)


def test_a_missing_one_is_named(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"state\.pt cannot be read"):
        read_checkpoint(tmp_path / "state.pt")


def test_a_full_disk_leaves_the_file_of_before_and_no_draft(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "state.pt"
    write_checkpoint(path, STATE)
    before = path.read_bytes()

    def full(self: Path, content: bytes) -> None:
        with self.open("wb") as file:
            file.write(content[:100])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match="No space left"):
        write_checkpoint(path, STATE | {"step": 4})
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["state.pt"]


def test_a_run_that_was_killed_before_its_first_checkpoint_leaves_no_lines(
    tmp_path: Path, solved: list[SolvedCase], monkeypatch: pytest.MonkeyPatch
) -> None:
    def killed(self: Trainer) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(Trainer, "_save", killed)
        for _ in range(2):
            with pytest.raises(KeyboardInterrupt):
                Trainer(CONFIG, tmp_path, solved[:6], solved[6:]).run()
    assert len((tmp_path / "log.jsonl").read_text().splitlines()) == 1
    Trainer(CONFIG, tmp_path, solved[:6], solved[6:]).run()
    assert len((tmp_path / "log.jsonl").read_text().splitlines()) == 1
    assert len(list((tmp_path / "tensorboard").iterdir())) == 1


def test_a_run_can_stop_at_a_step_and_go_on(tmp_path: Path, solved: list[SolvedCase]) -> None:
    trainers = [Trainer(CONFIG, tmp_path / name, solved[:6], solved[6:]) for name in ("pieces", "whole")]
    trainers[0].run(until=1)
    assert trainers[0].step == 1
    for trainer in trainers:
        trainer.run(until=9)
    states = [trainer.network.state_dict() for trainer in trainers]
    assert all(torch.equal(tensor, states[1][name]) for name, tensor in states[0].items())


def test_the_checkpoint_of_another_recipe_is_still_refused(tmp_path: Path, solved: list[SolvedCase]) -> None:
    Trainer(CONFIG, tmp_path, solved[:6], solved[6:]).run()
    with pytest.raises(ValueError, match="another configuration"):
        Trainer(replace(CONFIG, seed=1), tmp_path, solved[:6], solved[6:])
