# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The card that goes with a policy."""

import json
from pathlib import Path

import pytest

from magat_robot.policy.config import PolicyConfig
from magat_training.card import card
from magat_training.trainer import TrainConfig

CASES = {
    "seed": 2021,
    "size": {"width": 12, "height": 14, "robots": 7, "density": 0.2},
    "expert": {"w": 1.1, "node_limit": 20_000},
    "splits": {"train": [0, 21_000], "valid": [21_000, 25_500], "test": [25_500, 30_000]},
}
RECORD = {"loss": 0.5, "seconds": 60.0, "online_instants": 4321, "p_rg": 0.99}


def test_the_card_tells_how_the_policy_was_trained_and_which_checkpoint_was_chosen(tmp_path: Path) -> None:
    scores = {111: (0.5, 0.1), 222: (0.9, 0.3), 333: (0.9, 0.1), 444: (0.8, 0.1)}
    log = [RECORD | {"step": step, "alpha": alpha, "delta_ft": ft} for step, (alpha, ft) in scores.items()]
    (tmp_path / "log.jsonl").write_text("".join(json.dumps(record) + "\n" for record in log))
    text = card(TrainConfig(PolicyConfig("MAGAT-B-16"), seed=77), tmp_path, CASES, "two cores")
    assert text.startswith("# MAGAT-B-16\n")
    assert "12x14 cells with 7 robots and 20 % obstacles" in text
    assert "| 333 | 0.1 |" in text, "149,184 observations: 333 steps of 64 instants of 7 robots"
    assert "seed 77" in text
    assert "two cores" in text
    assert "| 4321 |" in text
    assert "step 333" in text  # the most successes, and of these the shorter way
    assert not any(f"step {step}" in text for step in (111, 222, 444))
    rows = [line.split("|")[1].strip() for line in text.splitlines() if line.startswith("| ")]
    assert rows[1:] == ["111", "222", "333", "444"]


@pytest.mark.parametrize(("online", "said"), [("off", "none"), ("failures", "last state"), ("states", "every state")])
def test_the_card_says_what_the_online_expert_corrected(tmp_path: Path, online: str, said: str) -> None:
    (tmp_path / "log.jsonl").write_text(json.dumps(RECORD | {"step": 5, "alpha": 0.5, "delta_ft": 0.5}) + "\n")
    assert (
        said
        in card(TrainConfig(online=online), tmp_path, CASES, "one core").split("Online expert: ")[1].split("\n- ")[0]
    )
