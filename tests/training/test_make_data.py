# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""`magat data`: it makes a data set, says what is in it, and can be interrupted."""

import signal

import pytest

from magat_cli.main import INTERRUPTED, main
from magat_training import make_data as data
from magat_training.data import check_data_set, make_data_set, read_data_set, read_manifest

SMALL = ["--cases", "20", "--robots", "4", "--width", "9", "--height", "8", "--seed", "5"]


def said(capfd) -> str:
    captured = capfd.readouterr()
    return " ".join((captured.out + captured.err).split())


def test_a_data_set_is_made_and_shown(capfd, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["data", "make", *SMALL]) == 0
    manifest = check_data_set(tmp_path / "data" / "9x8-4")
    assert "data/9x8-4: 20 of 20 cases solved" in (made := said(capfd))
    assert manifest["sha256"] in made
    assert (manifest["recipe"]["seed"], manifest["recipe"]["size"]["density"]) == (5, 0.1)
    assert [s.number for s in read_data_set(tmp_path / "data" / "9x8-4", "valid")] == [21_000, 21_001, 21_002]

    assert main(["data", "show", "data/9x8-4"]) == 0
    shown = said(capfd)
    for text in ("9x8 cells, 4 robots, density 0.1", "seed 5", "train 0 to 13 14 14", manifest["sha256"]):
        assert text in shown


def test_an_interrupted_command_says_how_it_is_resumed_and_resumes(capfd, tmp_path, monkeypatch):
    def interrupted(*args, progress, **options):
        def interrupt(done):
            progress(done)
            if done == 9:
                signal.raise_signal(signal.SIGINT)

        return make_data_set(*args, progress=interrupt, shard=4, **options)

    folder = tmp_path / "set"
    command = ["data", "make", *SMALL, "--output", str(folder)]
    with monkeypatch.context() as patch:
        patch.setattr(data, "make_data_set", interrupted)
        assert main(command) == INTERRUPTED
        assert "interrupted: the same command resumes the data set" in said(capfd)
        assert sorted(path.name for path in folder.iterdir()) == ["train-00000.npz", "train-00004.npz"]
        patch.setattr(data, "make_data_set", lambda *args, **options: make_data_set(*args, shard=4, **options))
        assert main(command) == 0
    assert read_manifest(folder)["splits"]["train"]["solved"] == 14


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["make", "--cases", "2"], "ask for 3 to 30000"),
        (["make", "--cases", "30001"], "ask for 3 to 30000"),
        (["make", "--robots", "500"], "do not fit"),
        (["make", "--seed", "-1"], "seed of at least 0"),
        (["make", "--cases", "3", "--output", "file"], "the folder file cannot be made"),
        (["show", "nowhere"], "nowhere has no manifest.json"),
    ],
)
def test_what_cannot_be_done_is_said_in_a_sentence(capfd, tmp_path, monkeypatch, arguments, problem):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    assert main(["data", *arguments]) == 1
    assert problem in said(capfd)


def test_a_damaged_data_set_is_not_shown(capfd, tmp_path):
    folder = tmp_path / "set"
    assert main(["data", "make", *SMALL, "--output", str(folder)]) == 0
    path = folder / "test-25500.npz"
    path.write_bytes(path.read_bytes()[:-50])
    assert main(["data", "show", str(folder)]) == 1
    assert "holds no solved cases" in said(capfd)
