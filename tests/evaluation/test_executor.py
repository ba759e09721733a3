# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Work in other processes and on a Dask cluster: the same results as in this process, and errors in one line."""

import io
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from distributed import LocalCluster
from rich.console import Console

from magat_cli.main import main
from magat_evaluation import executor as executor_module
from magat_evaluation.candidates import Candidate
from magat_evaluation.evaluate import evaluate_candidate
from magat_evaluation.executor import executor
from magat_evaluation.sets import CaseSet
from magat_node.errors import MagatError

QUIET = Console(file=io.StringIO())


#: A cluster of processes, one of which ends in the middle of its work.
LOST = """
import os
import sys
from pathlib import Path

from distributed import LocalCluster

from magat_evaluation.executor import executor

def end_once(mark):
    if not Path(mark).exists():
        Path(mark).write_text("")
        os._exit(1)
    return "done"

if __name__ == "__main__":
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:
        with executor(cluster.scheduler_address) as pool:
            print(list(pool.map(end_once, [sys.argv[1]])))
"""


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    """The address of a cluster of two threads in this process."""
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=False, dashboard_address=None, protocol="tcp") as up:
        yield up.scheduler_address


def late(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def end_once(mark: str) -> str:
    """End the worker when this is called for the first time."""
    if not Path(mark).exists():
        Path(mark).write_text("")
        os._exit(1)
    return "done"


def test_results_come_in_the_order_of_the_items(cluster: str) -> None:
    with executor(cluster) as pool:
        assert list(pool.map(late, [0.2, 0.0, 0.1])) == [0.2, 0.0, 0.1]


@pytest.mark.parametrize("where", ["a process", "a cluster"])
def test_an_evaluation_elsewhere_measures_the_same(cluster: str, monkeypatch: pytest.MonkeyPatch, where: str) -> None:
    monkeypatch.setattr("magat_evaluation.evaluate.BATCH_ROBOTS", 20)
    candidate, cases = Candidate.of_baseline("greedy"), CaseSet.square(20, 10, 5)
    workers = cluster if where == "a cluster" else 2
    here, there = (evaluate_candidate(candidate, cases, QUIET, place) for place in (1, workers))
    assert there.to_json() | {"seconds": None} == here.to_json() | {"seconds": None}


def test_the_commands_take_a_cluster(cluster: str, tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    folders = [tmp_path / name for name in ("here", "there")]
    for folder, more in zip(folders, ([], ["--cluster", cluster]), strict=True):
        assert main(["data", "make", "--cases", "12", "--output", str(folder), *more]) == 0
    contents = [{path.name: path.read_bytes() for path in folder.iterdir()} for folder in folders]
    assert contents[0] == contents[1]
    arguments = ["evaluate", "--policy", "greedy", "--cases", "3", "--json"]
    capfd.readouterr()
    shown = []
    for more in ([], ["--cluster", cluster]):
        assert main([*arguments, *more]) == 0
        shown.append([line for line in capfd.readouterr().out.splitlines() if '"seconds"' not in line])
    assert shown[0] == shown[1]


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense", "ftp://127.0.0.1:1"])
def test_a_cluster_that_does_not_answer_is_named_in_one_line(
    address: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture
) -> None:
    monkeypatch.setattr(executor_module, "PATIENCE", 0.5)
    started = time.monotonic()
    assert main(["evaluate", "--policy", "greedy", "--cases", "2", "--cluster", address]) == 1
    assert time.monotonic() - started < 10
    lines = capfd.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert f"no Dask scheduler answers at {address}" in lines[0]


def test_a_cluster_without_workers_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executor_module, "PATIENCE", 0.5)
    with (
        LocalCluster(n_workers=0, processes=False, dashboard_address=None, protocol="tcp") as empty,
        pytest.raises(MagatError, match="has no worker: start some"),
        executor(empty.scheduler_address),
    ):
        pass


def test_the_work_of_a_lost_worker_is_done_again(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(LOST)
    done = subprocess.run(
        [sys.executable, str(program), str(tmp_path / "mark")], capture_output=True, text=True, timeout=90, check=True
    )
    assert done.stdout == "['done']\n"
    assert (tmp_path / "mark").exists()


def test_a_killed_process_is_named(tmp_path: Path) -> None:
    with pytest.raises(MagatError, match="one of 2 processes was killed"), executor(2) as pool:
        list(pool.map(end_once, [str(tmp_path / "mark")]))
