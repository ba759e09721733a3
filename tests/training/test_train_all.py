# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""``magat train --all``: each of the family's trainings runs, and one command does them all, in whatever pieces."""

import io
import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest
from rich.console import Console

from magat_cli.main import main
from magat_evaluation.family import CONTROL, FAMILY, PAPER, Training
from magat_node.lock import locked
from magat_robot.policy.folder import read_folder
from magat_training import train_all as train_all_module
from magat_training.recipe import read_recipe
from magat_training.train_all import config_of, install
from magat_training.train_policy import Options, is_finished, train_policy
from magat_training.trainer import TrainConfig

#: As small as trainings can be.
TINY = {
    "train_cases": 6,
    "valid_cases": 2,
    "steps": 2,
    "batch": 2,
    "validate_every": 2,
    "online_from": 1,
    "online_every": 1,
    "online_cases": 2,
}
THREE = (Training("GNN-F-16"), Training("MAGAT-F-128", taps=1), Training("GNN-F-16", seed=1))
QUIET = Console(file=io.StringIO())


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data") / "small"
    sizes = ["--width", "10", "--height", "10", "--robots", "3"]
    assert main(["data", "make", "--cases", "12", "--output", str(folder), *sizes]) == 0
    return folder


@pytest.fixture(autouse=True)
def _tiny(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("magat_training.train_all", "magat_training.train_policy"):
        monkeypatch.setattr(f"{module}.ensure_data", lambda *_: None)
    monkeypatch.setattr("magat_training.train_policy.ensure_exported", lambda _: None)


@pytest.fixture
def everything(tmp_path: Path, data: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    """``magat train --all`` with a family of three."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(train_all_module, "FAMILY", THREE)
    monkeypatch.setattr(train_all_module, "config_of", lambda training, changes: config_of(training, TINY | changes))
    command = ["train", "--all", "--data", str(data), "--threads", "1", "--no-measure", "--install"]
    return lambda *more: main([*command, *more])


def test_the_family_is_the_papers_and_more() -> None:
    names = [training.name for training in FAMILY]
    assert len(set(names)) == len(names) == 20 + 1 + 2 * 6
    widths = [f"{kind}-{width}" for kind in ("MAGAT-F", "MAGAT-B", "GNN-F", "GNN-B") for width in (128, 64, 32, 16)]
    more = ["MAGAT-F-32-P4", "MAGAT-B-32-P4", "GAT-F-128", "GNN_baseline-F-128"]
    assert Counter(names[:20]) == Counter([*widths, *more])
    assert names[20:23] == ["MAGAT-F-128-K1", "MAGAT-F-128-S1", "GNN-F-128-S1"]
    assert [training.shipped for training in FAMILY] == [True] * 20 + [False] * 13


@pytest.mark.parametrize("training", [*PAPER, CONTROL], ids=lambda training: training.name)
def test_each_trains_by_its_name_alone(tmp_path: Path, data: Path, training: Training) -> None:
    assert config_of(training) == (read_recipe(training.policy) if training.taps == 2 else config_of(CONTROL)), (
        "the defaults of the recipe"
    )
    config = config_of(training, TINY)
    assert (config.policy.taps, config.policy.cnn) == (training.taps, TrainConfig().policy.cnn)
    assert not is_finished(config, tmp_path)
    folder = train_policy(config, tmp_path, Options(data, measures=False), QUIET)
    assert folder == tmp_path / training.name
    assert is_finished(config, tmp_path)
    assert read_folder(folder)[0] == config.policy


def test_one_command_trains_all_and_leaves_what_is_finished(
    everything: Callable[..., int], tmp_path: Path, capfd: pytest.CaptureFixture
) -> None:
    assert everything() == 0
    policies = [tmp_path / "runs" / training.name / training.name / "model.safetensors" for training in THREE]
    before = [policy.stat().st_mtime_ns for policy in policies]
    assert [folder.name for folder in (tmp_path / "models").iterdir()] == ["GNN-F-16"]
    files = ("card.md", "config.json", "log.jsonl", "model.safetensors", "training.yaml")
    assert sorted(file.name for file in (tmp_path / "models" / "GNN-F-16").iterdir()) == sorted(files)
    capfd.readouterr()
    assert everything() == 0
    assert capfd.readouterr().err.count("is finished") == 3
    assert [policy.stat().st_mtime_ns for policy in policies] == before


def test_a_failure_is_reported_at_the_end_and_does_not_stop_the_rest(
    everything: Callable[..., int], tmp_path: Path, capfd: pytest.CaptureFixture
) -> None:
    assert everything() == 0
    log = tmp_path / "runs" / "GNN-F-16" / "GNN-F-16" / "training.yaml"
    log.unlink()  # so that it is not finished
    checkpoint = tmp_path / "runs" / "GNN-F-16" / "checkpoint.pt"
    checkpoint.write_bytes(checkpoint.read_bytes()[:-100])
    (tmp_path / "runs" / "GNN-F-16-S1" / "GNN-F-16-S1" / "training.yaml").unlink()
    capfd.readouterr()
    assert everything() == 1
    shown = " ".join(capfd.readouterr().err.split())
    assert "GNN-F-16 failed:" in shown
    assert "checkpoint.pt is damaged" in shown
    assert (tmp_path / "runs" / "GNN-F-16-S1" / "GNN-F-16-S1" / "training.yaml").exists()


def test_a_bug_in_one_training_does_not_stop_the_rest(
    everything: Callable[..., int], tmp_path: Path, capfd: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(config: TrainConfig, *arguments: object) -> Path:
        if config.seed == 0:
            raise ZeroDivisionError
        return train_policy(config, *arguments)

    monkeypatch.setattr(train_all_module, "train_policy", broken)
    assert everything() == 1
    assert capfd.readouterr().err.count("failed: ZeroDivisionError()") == 2
    assert (tmp_path / "runs" / "GNN-F-16-S1" / "GNN-F-16-S1").exists()


def test_an_interrupted_one_is_resumed(
    everything: Callable[..., int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("magat_training.train_policy.card", interrupted)
        assert everything() == 130
    assert not (tmp_path / "runs" / "GNN-F-16" / "GNN-F-16").exists()
    assert everything() == 0
    assert "resuming runs/GNN-F-16 at step 2" in capfd.readouterr().err
    assert len((tmp_path / "runs" / "GNN-F-16" / "log.jsonl").read_text().splitlines()) == 1


def test_what_another_process_trains_is_left_to_it(
    everything: Callable[..., int], tmp_path: Path, capfd: pytest.CaptureFixture
) -> None:
    with locked(tmp_path / "runs" / "GNN-F-16"):
        assert everything() == 0
        assert "in training by other processes: GNN-F-16\n" in capfd.readouterr().err
        assert [
            training.name for training in THREE if (tmp_path / "runs" / training.name / training.name).exists()
        ] == [
            "MAGAT-F-128-K1",
            "GNN-F-16-S1",
        ]


def test_a_folder_that_is_in_use_is_refused_in_one_line(
    tmp_path: Path, data: Path, capfd: pytest.CaptureFixture
) -> None:
    with locked(tmp_path / "run"):
        assert main(["train", "GNN-F-16", "--data", str(data), "--output", str(tmp_path / "run")]) == 1
    lines = capfd.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert "another process writes to" in lines[0]
    with locked(data):
        assert main(["data", "make", "--cases", "12", "--output", str(data)]) == 1
    assert "another process writes to" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("more", "complaint"), [(["GNN-F-16"], "remove GNN-F-16"), (["--seed", "3"], "--seed has no effect with --all")]
)
def test_options_of_one_training_are_refused(
    everything: Callable[..., int], capfd: pytest.CaptureFixture, more: list[str], complaint: str
) -> None:
    assert everything(*more) == 1
    assert complaint in " ".join(capfd.readouterr().err.split())


def test_measures_of_the_same_weights_are_kept_when_they_are_installed_again(tmp_path: Path, data: Path) -> None:
    config = config_of(THREE[0], TINY)
    folder = train_policy(config, tmp_path / "run", Options(data, measures=False), QUIET)
    assert install(folder, tmp_path / "models")
    measures = tmp_path / "models" / folder.name / "measures.json"
    measures.write_text("[]")
    assert not install(folder, tmp_path / "models")
    assert measures.exists()
    stored = json.loads((measures.parent / "config.json").read_text())
    (measures.parent / "config.json").write_text(json.dumps(stored | {"sha256": "0" * 64}))
    assert install(folder, tmp_path / "models")
    assert not measures.exists()
