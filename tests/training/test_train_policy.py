# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""``magat train``: from a recipe to a policy folder, and the bench of training."""

import io
import json

import numpy as np
import pytest
from rich.console import Console

from magat_bench.training import PARTS, bench_training, table
from magat_cli.main import main
from magat_evaluation.measures_file import read
from magat_evaluation.sets import CaseSet
from magat_robot.policy.store import load
from magat_training import train_policy as training
from magat_training.recipe import read_recipe, recipe

RECIPE = """
policy: {name: GNN-B-8-P2, channels: [4, 4, 8], hidden: 16, temperature: 1.5}
train_cases: 14
valid_cases: 3
steps: 6
batch: 8
validate_every: 3
online_from: 2
online_every: 2
online_cases: 4
"""


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data") / "small"
    assert main(["data", "make", "--cases", "20", "--output", str(folder)]) == 0
    return folder


@pytest.fixture
def command(tmp_path, data, monkeypatch):
    monkeypatch.setattr(training, "STANDARD_SETS", (CaseSet.square(10, 3, 2),))
    recipe = tmp_path / "recipe.yaml"
    recipe.write_text(RECIPE)
    return ["train", str(recipe), "--data", str(data), "--threads", "1", "--output", str(tmp_path / "run")]


def test_training_leaves_a_policy_that_loads_and_decides_with_its_card_and_recipe(tmp_path, command):
    assert main(command) == 0
    folder = tmp_path / "run" / "GNN-B-8-P2"
    policy = load(folder)
    assert policy.config.temperature == 1.5
    view, streams = np.zeros((2, 3, 11, 11), dtype=np.uint8), np.zeros(2, dtype=np.uint64)
    assert policy.decide_together(view, np.array([[1], [0]]), streams, 0).weights.shape == (2, 5)
    assert read_recipe(str(folder / "training.yaml")) == read_recipe(command[1])
    assert [report.robots for report in read(folder)] == [3]
    text = (folder / "card.md").read_text()
    assert "| 6 |" in text, "the curve"
    assert "| 10x10 (3) | 2 | 1.5 |" in text, "what was measured"
    assert len((folder / "log.jsonl").read_text().splitlines()) == 2
    assert list((tmp_path / "run" / "tensorboard").iterdir())


def test_a_finished_run_is_left_as_it_is_and_a_changed_one_is_refused(tmp_path, command, capfd):
    assert main([*command, "--no-measure"]) == 0
    digest = load(tmp_path / "run" / "GNN-B-8-P2").digest
    assert not (tmp_path / "run" / "GNN-B-8-P2" / "measures.json").exists()
    assert main([*command, "--no-measure"]) == 0
    assert load(tmp_path / "run" / "GNN-B-8-P2").digest == digest
    assert main([*command, "--online", "off"]) == 1
    assert "another configuration" in " ".join(capfd.readouterr().err.split())


def test_options_stand_above_the_recipe(tmp_path, command):
    assert main([*command, "--no-measure", "--steps", "3", "--online", "failures", "--seed", "9"]) == 0
    kept = read_recipe(str(tmp_path / "run" / "GNN-B-8-P2-S9" / "training.yaml"))
    assert (kept.steps, kept.online, kept.seed, kept.batch) == (3, "failures", 9, 8)


def test_a_data_set_that_is_too_small_is_named(command, capfd, tmp_path):
    (tmp_path / "recipe.yaml").write_text(RECIPE.replace("train_cases: 14", "train_cases: 15"))
    assert main(command) == 1
    assert "holds 14 train cases, and the recipe asks for 15" in " ".join(capfd.readouterr().err.split())


def test_the_bench_accounts_for_every_part_of_a_run():
    padded = {"name": "MAGAT-F-16", "cnn": "padded"}
    recipes = [recipe({"policy": "MAGAT-F-16", "online_cases": 8}), recipe({"policy": padded, "online": "off"})]
    bench, other = bench_training(recipes, threads=1, steps=3, cases=20, console=Console(quiet=True))
    assert set(bench.parts) == set(PARTS)
    assert min(*bench.parts.values(), bench.online, bench.validation) > 0
    config = bench.config
    rounds = len([step for step in range(config.online_from, config.steps) if step % config.online_every == 0])
    assert bench.run["online expert"] == pytest.approx(rounds * bench.online)
    assert bench.rate == pytest.approx(640 / sum(bench.parts.values()))
    assert bench.run_rate < bench.rate
    assert sum(bench.operators.values()) == pytest.approx(1.0)
    assert bench.operators["convolutions"] > 0.2
    assert 2.5e6 < bench.flops < 3.5e6, "as counted by hand: 0.49 million products, three times, two operations each"
    assert 10e6 < other.flops < 40e6
    assert other.online == 0
    assert other.run["online expert"] == 0
    console = Console(width=200, file=io.StringIO(), record=True)
    console.print(table(bench))
    assert "observations per second" in console.export_text()


def test_the_log_of_the_run_is_kept_with_the_policy(tmp_path, command):
    assert main([*command, "--no-measure"]) == 0
    lines = (tmp_path / "run" / "GNN-B-8-P2" / "log.jsonl").read_text().splitlines()
    assert [json.loads(line)["step"] for line in lines] == [3, 6]
