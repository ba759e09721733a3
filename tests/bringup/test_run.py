# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""However a run ends, what was done is in its folder and in the table."""

import errno
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import pytest
from rich.console import Console

from magat_bringup import run_folder as folders
from magat_bringup.client import EpisodeError, EpisodeOutcome
from magat_bringup.results import RunResults
from magat_bringup.run import run
from magat_bringup.run_folder import begin, run_folder
from magat_bringup.run_plan import RunPlan
from magat_bringup.team import TeamFile, TeamPlan
from magat_interfaces.action import RunEpisode
from magat_node.errors import MagatError, TeamError
from magat_recording.bag import BagWriter
from magat_recording.world_log import WorldLog
from magat_robot.policy.models import find_policy

UNSOLVABLE = "the expert gives no makespan (no solution): set t_max, or take another case"


def result(**fields: object) -> RunEpisode.Result:
    values = {"success": True, "p_rg": 1.0, "ticks": 20, "t_max": 60, "makespan": 18, "ticks_per_second": 50.0}
    return RunEpisode.Result(**values | {"silent": 3, "features_missing": 5, "secret": [1, 171]} | fields)


def outcome(**fields: object) -> EpisodeOutcome:
    return EpisodeOutcome(result(**fields), WorldLog())


class Client:
    """Instead of a team: each episode has the next of its ``ends``, an outcome or an error."""

    def __init__(self, ends: list) -> None:
        self._ends = iter(ends)

    def __enter__(self) -> "Client":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def wait_for_simulator(self, timeout: float) -> None:
        pass

    def wait_for_recorder(self) -> None:
        pass

    def run(self, goal: object, on_feedback: object) -> EpisodeOutcome:
        end = next(self._ends)
        if isinstance(end, BaseException):
            raise end
        return end


@pytest.fixture
def start(monkeypatch, tmp_path):
    """Runs as many episodes as there are ends; returns what was printed, the results and the error."""

    def make(*ends: object, recorder: str = "", record: Path | None = None) -> SimpleNamespace:
        processes = mock.MagicMock()
        processes.return_value.__enter__.return_value.given_up = {"recorder": recorder} if recorder else {}
        monkeypatch.setattr("magat_bringup.run.TeamProcesses", processes)
        monkeypatch.setattr("magat_bringup.run.EpisodeClient", lambda *_: Client(list(ends)))
        plan = RunPlan(len(ends), 20, 20, 0.1, 1, 100, output=tmp_path / "out", record=record)
        console, error = Console(record=True, width=80, file=open(os.devnull, "w")), None  # noqa: SIM115
        try:
            with mock.patch.dict(os.environ):
                run(plan, TeamPlan(TeamFile.numbered(10), find_policy("MAGAT-F-128")), console)
        except BaseException as raised:
            error = raised
        file = tmp_path / "out" / "results.json"
        rows = json.loads(file.read_text()) if file.exists() else None
        return SimpleNamespace(text=console.export_text(), rows=rows, error=error, folder=tmp_path / "out")

    return make


@pytest.mark.parametrize("end", [KeyboardInterrupt(), TeamError("simulator: killed"), RuntimeError("a bug")])
def test_an_abnormal_end_loses_no_finished_episode(start, end):
    done = start(outcome(), outcome(success=False, p_rg=0.9), end)
    assert done.error is end
    assert [row["success"] for row in done.rows] == [True, False]
    assert "9 of 10" in done.text
    assert "1 of 2" in done.text
    assert not (done.folder / "results.jsonl").exists()


def test_a_case_that_the_expert_cannot_solve_is_a_row_and_the_others_are_run(start):
    done = start(outcome(), EpisodeError(result(error=UNSOLVABLE, success=False)), outcome())
    assert "1 of 3 episodes were not run: 101" in str(done.error)
    assert [row["error"] for row in done.rows] == ["", UNSOLVABLE, ""]
    assert [row["case"] for row in done.rows] == ["100", "101", "102"]
    assert re.search(r"101\s+not run", done.text)
    assert "not run, case 101: the episode failed: the expert gives no makespan" in " ".join(done.text.split())
    assert "2 of 2" in done.text


def test_an_episode_that_fails_for_the_team_ends_the_run(start):
    done = start(outcome(), EpisodeError(result(error="not there after 60 s: alice")), outcome())
    assert isinstance(done.error, EpisodeError)
    assert len(done.rows) == 2


def test_the_table_has_silent_beside_missing_and_fits_into_80_columns(start):
    done = start(outcome(silent=123_456, features_missing=123_456, moves_blocked=12_345, t_max=12_345, ticks=12_345))
    assert re.search(r"missing\s+silent", done.text)
    assert re.search(r"123456\s+123456", done.text)
    assert max(map(len, done.text.splitlines())) <= 80


def test_a_secret_is_kept_in_hexadecimal(start):
    assert start(outcome()).rows[0]["secret"] == "01ab"


def test_an_episode_without_all_its_worlds_has_no_picture_but_a_result(start):
    done = start(outcome())
    assert done.error is None
    assert "There is no picture: 0 of 21" in done.text
    assert len(done.rows) == 1


def test_a_recorder_that_was_given_up_fails_the_run_after_its_results(start):
    done = start(outcome(), recorder="ended with status 1", record=Path())
    assert "the recording is not complete: the recorder ended with status 1" in str(done.error)
    assert len(done.rows) == 1


def test_a_recording_that_was_not_finished_fails_the_run_after_its_results(start, tmp_path):
    writer = BagWriter(tmp_path / "bag")
    with mock.patch("magat_bringup.run.check_run"):
        done = start(outcome(), record=tmp_path / "bag")
    assert f"the recording in {tmp_path / 'bag'} was not finished" in str(done.error)
    assert "is empty" in done.text
    writer.close()
    with mock.patch("magat_bringup.run.check_run"):
        assert start(outcome(), record=tmp_path / "bag").error is None


def test_results_are_kept_after_each_episode(tmp_path):
    results = RunResults(tmp_path, 10)
    for case in ("a", "b"):
        results.add(case, result())
        lines = (tmp_path / "results.jsonl").read_text().splitlines()
        assert json.loads(lines[-1])["case"] == case
    assert not (tmp_path / "results.json").exists()


def test_a_full_disk_ends_no_episode_and_is_named(tmp_path, monkeypatch):
    results = RunResults(tmp_path, 10)
    full = mock.Mock(side_effect=OSError(errno.ENOSPC, "No space left on device"))
    monkeypatch.setattr(Path, "open", full)
    results.add("a", result())
    results.add("b", result())
    assert results.problems == [f"the results in {tmp_path} are not complete (No space left on device)"]
    assert len(results.run) == 2


def test_the_table_is_printed_though_standard_output_is_closed(tmp_path):
    """As with `| head`: the reader leaves in the second of three episodes."""
    program = f"""
import os, sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
from pathlib import Path
from unittest import mock
from rich.console import Console
import magat_bringup.run as module
from test_run import Client, RunPlan, TeamFile, TeamPlan, find_policy, outcome

reading, writing = os.pipe()
os.dup2(writing, 1)
os.close(writing)

def ends():
    yield outcome()
    os.close(reading)
    yield outcome()
    raise AssertionError("the run went on")

module.TeamProcesses = mock.MagicMock()
module.EpisodeClient = lambda *_: Client(ends())
plan = RunPlan(3, 20, 20, 0.1, 1, 100, output=Path({str(tmp_path)!r}))
module.run(plan, TeamPlan(TeamFile.numbered(10), find_policy("MAGAT-F-128")), Console())
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert "alpha 1.00" in done.stderr
    assert len(json.loads((tmp_path / "results.json").read_text())) == 2


# --- Folders ---


@pytest.fixture
def runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(folders.time, "strftime", lambda *_: "2026-11-27_14-03-22")
    return Path("runs")


def test_each_run_has_a_folder_of_its_own_and_latest_leads_to_the_newest(runs):
    for name in ("2026-11-27_14-03-22", "2026-11-27_14-03-22_2"):
        with run_folder(None) as folder:
            assert folder == runs / name
            begin(folder, newest=True)
            (folder / "results.json").write_text("[]")
        assert (runs / "latest").resolve() == folder.resolve()
        assert os.readlink(runs / "latest") == name


def test_two_runs_at_once_have_two_folders(runs):
    with run_folder(None) as one, run_folder(None) as other:
        assert one != other
        assert one.is_dir()
        assert other.is_dir()
    assert list(runs.iterdir()) == [], "both stayed empty"


def test_a_folder_of_an_older_version_is_kept_under_another_name(runs):
    (runs / "latest").mkdir(parents=True)
    (runs / "latest" / "results.json").write_text("[1]")
    with run_folder(None) as folder:
        begin(folder, newest=True)
        (folder / "results.json").write_text("[]")
    assert (runs / "latest").is_symlink()
    assert [path.read_text() for path in runs.glob("*_latest/results.json")] == ["[1]"]


def test_a_folder_that_another_run_uses_is_refused(tmp_path):
    with run_folder(tmp_path / "out"), pytest.raises(MagatError, match="another process writes to"):
        run_folder(tmp_path / "out").__enter__()
    with run_folder(tmp_path / "out"):
        pass


def test_no_file_of_an_earlier_run_stays_beside_new_ones(tmp_path):
    (tmp_path / "logs").mkdir()
    old = ["results.json", "results.jsonl", "episode.png", "episode.gif", "logs/viewer.log"]
    for name in (*old, "notes.txt"):
        (tmp_path / name).write_text("old")
    begin(tmp_path, newest=False)
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["notes.txt"]
