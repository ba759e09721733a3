# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recipes: the names and files that training starts from."""

from dataclasses import replace
from pathlib import Path

import pytest

from magat_robot.policy.config import ModelError, PolicyConfig
from magat_training.recipe import read_recipe, recipe, write_recipe
from magat_training.trainer import TrainConfig


def test_a_name_stands_for_the_defaults() -> None:
    config = read_recipe("GNN-B-64")
    assert config.policy.name == "GNN-B-64"
    assert config == TrainConfig(policy=config.policy)
    assert config.policy.temperature == TrainConfig().policy.temperature


def test_a_file_gives_back_what_was_written(tmp_path: Path) -> None:
    policy = PolicyConfig("GAT-F-16-P2", (4, 8, 16), 32, taps=3, layers=2, normalise=False, temperature=0.5)
    config = TrainConfig(policy=policy, steps=7, first_rate=0.01, online="off", seed=3)
    write_recipe(config, tmp_path / "recipe.yaml")
    assert read_recipe(str(tmp_path / "recipe.yaml")) == config


def test_what_a_recipe_leaves_out_is_the_default() -> None:
    assert recipe({"policy": "GAT-F-32", "steps": 9}) == TrainConfig(
        policy=replace(TrainConfig().policy, name="GAT-F-32"), steps=9
    )
    assert recipe({"policy": {"taps": 3}}).policy.name == "MAGAT-F-128"


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"epochs": 3}, "no field 'epochs'"),
        ({"steps": "many"}, "steps is 'many': it is a int"),
        ({"steps": 1.5}, "steps is 1.5"),
        ({"first_rate": True}, "first_rate is True"),
        ({"online": "always"}, "'always'"),
        ({"policy": "MAGIC"}, "MAGIC"),
        ({"policy": ["MAGAT-F-128"]}, "give the name of one"),
        ({"policy": {"size": 3}}, "exactly the keys"),
        ({"policy": {"hidden": 0}}, "sizes"),
    ],
    ids=repr,
)
def test_what_does_not_exist_is_refused_by_name(values: dict, said: str) -> None:
    with pytest.raises(ModelError, match=said):
        recipe(values)


@pytest.mark.parametrize("text", ["", "- steps", "steps: [", "just words"], ids=repr)
def test_a_file_that_is_no_recipe_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "bad.yaml").write_text(text)
    with pytest.raises(ModelError, match=r"bad\.yaml"):
        read_recipe(str(tmp_path / "bad.yaml"))


def test_gnn_baseline_keeps_the_widths_of_its_paper_and_all_others_share_theirs() -> None:
    assert read_recipe("GNN_baseline-F-128").policy.channels == PolicyConfig().channels == (32, 64, 128)
    assert read_recipe("GNN-B-16").policy.channels == TrainConfig().policy.channels == (32, 32, 128)
    assert recipe({"policy": {"name": "GNN_baseline-F-16", "channels": [4, 4, 8]}}).policy.channels == (4, 4, 8)
