# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Data sets: what is made is read, whatever happened in between; what is not as it was made is refused."""

import hashlib
import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from magat_evaluation import cases
from magat_evaluation.cases import SolvedCase, first_cases, solved_cases
from magat_evaluation.splits import SPLITS
from magat_sim.case import InvalidCaseError
from magat_training import data
from magat_training.data import DataSetError, check_data_set, make_data_set, read_data_set, read_manifest

SIZE = {"width": 11, "height": 7, "robots": 5, "density": 0.15}
NUMBERS = {"train": range(10), "valid": range(40, 44), "test": range(60, 63)}
#: Of the cases above in shards of 4.
DIGEST = "a3b59e6ba6ea6a3491b9dd6a4c2b86fb2b76203785b43821224eae7db5d49b05"


def make(folder: Path, **changes: object) -> dict:
    return make_data_set(folder, **{"splits": NUMBERS, "size": SIZE, "workers": 1, "shard": 4} | changes)


@pytest.fixture
def made(tmp_path: Path) -> Path:
    make(tmp_path / "set")
    return tmp_path / "set"


def same(read: list[SolvedCase], written: list[SolvedCase]) -> bool:
    def content(solved: SolvedCase) -> list:
        arrays = (solved.case.obstacles, solved.case.starts, solved.case.goals, solved.paths)
        return [solved.number, *((array.dtype, array.shape, array.tobytes()) for array in arrays)]

    return [content(one) for one in read] == [content(one) for one in written]


def flip(path: Path, part: float) -> None:
    content = bytearray(path.read_bytes())
    content[int(part * len(content))] ^= 0x10
    path.write_bytes(content)


def cut(path: Path, part: float) -> None:
    path.write_bytes(path.read_bytes()[: int(part * path.stat().st_size)])


DAMAGES = {
    "missing": lambda path: path.unlink(),
    "text": lambda path: path.write_text("hello"),
    "empty": lambda path: path.write_bytes(b""),
    **{f"cut {part}": lambda path, part=part: cut(path, part) for part in (0.2, 0.99)},
    **{f"bit {part}": lambda path, part=part: flip(path, part) for part in (0.2, 0.3, 0.4, 0.5, 0.6)},
}


def test_what_is_made_is_read(made: Path) -> None:
    for split, numbers in NUMBERS.items():
        assert same(read_data_set(made, split), list(solved_cases(numbers, workers=1, **SIZE))), split


def test_the_manifest_says_what_is_in_the_folder(tmp_path: Path) -> None:
    manifest = make(tmp_path)
    assert manifest == read_manifest(tmp_path) == check_data_set(tmp_path)
    assert manifest["recipe"] == {
        "generator_version": cases.GENERATOR_VERSION,
        "seed": cases.SET_SEED,
        "size": SIZE,
        "expert": {"w": cases.EXPERT_W, "node_limit": cases.EXPERT_NODE_LIMIT},
        "splits": {"train": [0, 10], "valid": [40, 44], "test": [60, 63]},
        "shard": 4,
    }
    train = manifest["splits"]["train"]
    assert (train["drawn"], train["solved"], train["unsolved"]) == (10, 10, [])
    assert train["instants"] == sum(len(s.paths) for s in read_data_set(tmp_path, "train"))
    names = [name for split in manifest["splits"].values() for name in split["shards"]]
    expected = ["train-00000", "train-00004", "train-00008", "valid-00040", "test-00060"]
    assert names == [f"{name}.npz" for name in expected]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*names, "manifest.json"])


def test_a_seed_gives_the_same_data_set_for_ever(tmp_path: Path) -> None:
    assert make(tmp_path)["sha256"] == DIGEST, (
        "drawing or solving gives other cases or paths than before, or they are stored otherwise: if that is meant, "
        "raise GENERATOR_VERSION in magat_evaluation/cases.py, so that data sets made before are refused, and put the "
        "new hash into this test"
    )


def test_neither_workers_nor_the_type_of_a_number_change_the_hash(tmp_path: Path) -> None:
    one = make(tmp_path / "one", size=SIZE | {"density": 0})
    other = make(tmp_path / "other", size=SIZE | {"density": 0.0}, workers=2)
    assert one == other


@pytest.mark.parametrize("moment", ["solving", "writing a shard", "writing the manifest"])
def test_a_making_that_was_killed_goes_on(tmp_path: Path, moment: str) -> None:
    program = f"""
import os, signal
from pathlib import Path
from magat_training.data import make_data_set

def kill():
    os.kill(os.getpid(), signal.SIGKILL)

def write_half(path, content):
    Path.open(path, "wb").write(content[: len(content) // 2])
    if {moment!r} == ("writing the manifest" if "manifest" in path.name else "writing a shard") and done > 4:
        kill()
    Path.open(path, "wb").write(content)

def progress(cases):
    global done
    done = cases
    if {moment!r} == "solving" and done == 7:  # in the middle of the second shard
        kill()

Path.write_bytes = write_half
make_data_set(Path({str(tmp_path)!r}), splits={NUMBERS!r}, size={SIZE!r}, workers=1, shard=4, progress=progress)
"""
    assert subprocess.run([sys.executable, "-c", program], timeout=60).returncode == -signal.SIGKILL
    left = {path.name: path.stat().st_mtime_ns for path in tmp_path.glob("*.npz")}
    assert len(left) == (5 if "manifest" in moment else 1)
    for split in NUMBERS:
        with pytest.raises(DataSetError, match=r"has no manifest\.json"):
            read_data_set(tmp_path, split)

    assert make(tmp_path)["sha256"] == DIGEST
    assert check_data_set(tmp_path)["sha256"] == DIGEST
    assert not list(tmp_path.glob("*.draft"))
    for name, time in left.items():
        assert (tmp_path / name).stat().st_mtime_ns == time, f"{name} was whole, and is made again"


def test_progress_counts_every_case_once(tmp_path: Path) -> None:
    counts: list[int] = []
    make(tmp_path, progress=counts.append)
    assert list(dict.fromkeys(counts)) == list(range(1, 18))
    (tmp_path / "valid-00040.npz").unlink()
    counts.clear()
    make(tmp_path, progress=counts.append)
    assert list(dict.fromkeys(counts)) == [4, 8, 10, 11, 12, 13, 14, 17], "what is there is done at once"


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_shard_is_refused_by_its_name_and_made_again(made: Path, damage: str) -> None:
    path = made / "train-00004.npz"
    DAMAGES[damage](path)
    for check in (lambda: read_data_set(made, "train"), lambda: check_data_set(made)):
        with pytest.raises(DataSetError, match=r"train-00004\.npz holds no solved cases .* make the data set again"):
            check()
    assert len(read_data_set(made, "valid")) == 4, "the other splits are whole"
    make(made)
    assert check_data_set(made)["sha256"] == DIGEST


def test_a_shard_of_another_data_set_is_refused(made: Path, tmp_path: Path) -> None:
    make(tmp_path / "other", seed=1)
    (tmp_path / "other" / "train-00004.npz").replace(made / "train-00004.npz")
    with pytest.raises(DataSetError, match=r"train-00004\.npz has the hash \w+, but \w+ in the manifest"):
        read_data_set(made, "train")


@pytest.mark.parametrize("damage", [damage for damage in DAMAGES if damage != "missing"])
def test_a_damaged_manifest_is_refused_and_made_again(made: Path, damage: str) -> None:
    DAMAGES[damage](made / "manifest.json")
    with pytest.raises(DataSetError, match=r"manifest\.json .* make the data set again"):
        read_data_set(made, "train")
    make(made)
    assert check_data_set(made)["sha256"] == DIGEST


def test_a_manifest_that_was_changed_is_refused(made: Path) -> None:
    manifest = json.loads((made / "manifest.json").read_text())
    manifest["splits"]["train"]["solved"] = 11
    (made / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(DataSetError, match="does not match its own hash"):
        read_manifest(made)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"seed": 7}, "seed 2021; now it is seed 7"),
        ({"size": SIZE | {"robots": 4}}, "'robots': 5"),
        ({"splits": NUMBERS | {"test": range(60, 64)}}, r"'test': \[60, 64\]"),
        ({"shard": 5}, "shard 4; now it is shard 5"),
    ],
    ids=["seed", "size", "splits", "shard"],
)
def test_a_folder_of_another_recipe_is_left_alone(made: Path, changes: dict, said: str) -> None:
    before = {path.name: path.read_bytes() for path in made.iterdir()}
    with pytest.raises(DataSetError, match=rf"(?s){said}.*choose another folder, or delete this one"):
        make(made, **changes)
    assert {path.name: path.read_bytes() for path in made.iterdir()} == before


def test_a_data_set_of_another_version_of_the_generator_is_refused(made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(data, "GENERATOR_VERSION", 1_000)
    with pytest.raises(DataSetError, match=r"by version \d+ of the generator, and this is version 1000: delete"):
        read_data_set(made, "train")
    with pytest.raises(DataSetError, match="now it is generator_version 1000: choose another folder"):
        make(made)


def test_a_case_in_two_splits_is_refused_by_both_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def forged(numbers: range, *args: object, **options: object) -> list[SolvedCase]:
        # Case 41 is a copy of case 6.
        drawn = list(solved_cases([6 if number == 41 else number for number in numbers], *args, **options))
        return [SolvedCase(number, s.case, s.paths) for number, s in zip(numbers, drawn, strict=True)]

    monkeypatch.setattr(data, "solved_cases", forged)
    with pytest.raises(DataSetError, match=r"case 41 \(valid\) equals case 6 \(train\)"):
        make(tmp_path)
    assert not (tmp_path / "valid-00040.npz").exists()
    with pytest.raises(DataSetError, match=r"case 41 \(valid\) equals case 6 \(train\)"):
        make(tmp_path)  # the training split is there now


def test_a_case_in_two_splits_is_found_in_what_is_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    overlapping = {"train": range(4), "valid": range(3, 6)}
    with monkeypatch.context() as patch:
        patch.setattr(data, "_check_distinct", lambda *_: None)
        make(tmp_path, splits=overlapping)
    for check in (lambda: check_data_set(tmp_path), lambda: make(tmp_path, splits=overlapping)):
        with pytest.raises(DataSetError, match=r"case 3 \(valid\) equals case 3 \(train\)"):
            check()


def test_a_case_twice_in_one_split_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataSetError, match=r"\(train\) equals case \d+ \(train\).* larger maps or fewer cases"):
        make(tmp_path, splits={"train": range(40)}, size={"width": 3, "height": 1, "robots": 1, "density": 0.0})


def test_cases_without_a_solution_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cases, "EXPERT_NODE_LIMIT", 50)
    # In a corridor without a siding, two robots can only keep their order.
    corridor = {"width": 30, "height": 1, "robots": 2, "density": 0.0}
    manifest = make(tmp_path, splits={"all": range(12)}, size=corridor, shard=1)
    solved = [s.number for s in solved_cases(range(12), workers=1, **corridor)]
    summary = manifest["splits"]["all"]
    assert (summary["drawn"], summary["solved"]) == (12, len(solved))
    assert 0 < len(solved) < 12
    assert sorted(summary["unsolved"] + solved) == list(range(12))
    assert [s.number for s in read_data_set(tmp_path, "all")] == solved


def test_parameters_that_make_no_sense_are_refused(tmp_path: Path, made: Path) -> None:
    folder = tmp_path / "new"
    for wrong in ({"seed": -1}, {"shard": 0}, {"splits": {"train": range(0)}}, {"splits": {"train": range(0, 9, 2)}}):
        with pytest.raises(DataSetError, match="give"):
            make(folder, **wrong)
    with pytest.raises(InvalidCaseError, match="do not fit"):
        make(folder, size=SIZE | {"robots": 100})
    assert not folder.exists()
    with pytest.raises(DataSetError, match="has no split 'best': it has train, valid, test"):
        read_data_set(made, "best")


@pytest.mark.parametrize("count", [3, 4, 7, 100, 999, 29_999, 30_000])
def test_fewer_cases_are_the_first_of_each_split(count: int) -> None:
    some = first_cases(count)
    assert sum(map(len, some.values())) == count
    assert list(some) == list(SPLITS)
    for split, numbers in some.items():
        assert len(numbers) > 0
        assert numbers == SPLITS[split][: len(numbers)]
        assert len(numbers) / count == pytest.approx(len(SPLITS[split]) / 30_000, abs=2 / count)


@pytest.mark.parametrize("count", [0, 2, 30_001])
def test_cases_that_there_are_not_cannot_be_split(count: int) -> None:
    with pytest.raises(InvalidCaseError, match="ask for 3 to 30000"):
        first_cases(count)


def test_a_hash_is_that_of_the_arrays_and_not_of_the_file(made: Path) -> None:
    path = made / "valid-00040.npz"
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    content = hashlib.sha256()
    for name in sorted(arrays):
        array = arrays[name]
        content.update(f"{name} {array.dtype.str} {array.shape} ".encode() + array.tobytes())
    assert read_manifest(made)["splits"]["valid"]["shards"][path.name] == content.hexdigest()
    np.savez(path, **arrays)  # not compressed
    check_data_set(made)
