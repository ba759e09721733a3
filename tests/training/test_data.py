"""Solved cases survive a file; what is no such file is refused."""

from pathlib import Path

import numpy as np
import pytest

from magat_training.cases import SET_SEED, solved_cases
from magat_training.data import read_cases, write_cases


def test_what_is_written_is_read(tmp_path: Path) -> None:
    solved = list(solved_cases(range(20), width=11, height=7, robots=5))
    write_cases(tmp_path / "deep" / "cases.npz", SET_SEED, solved)
    seed, again = read_cases(tmp_path / "deep" / "cases.npz")
    assert seed == SET_SEED
    assert [s.number for s in again] == [s.number for s in solved]
    for read, written in zip(again, solved, strict=True):
        for name in ("obstacles", "starts", "goals"):
            before, after = getattr(written.case, name), getattr(read.case, name)
            assert after.dtype == before.dtype
            np.testing.assert_array_equal(after, before)
        np.testing.assert_array_equal(read.paths, written.paths)
        assert read.flowtime == written.flowtime
        assert read.t_max == written.t_max


def test_cases_of_different_sizes_do_not_share_a_file(tmp_path: Path) -> None:
    small = list(solved_cases(range(1), width=7, height=7, robots=3))
    large = list(solved_cases(range(1), width=9, height=7, robots=3))
    with pytest.raises(ValueError, match="different sizes"):
        write_cases(tmp_path / "cases.npz", 0, small + large)
    with pytest.raises(ValueError, match="nothing to write"):
        write_cases(tmp_path / "cases.npz", 0, [])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("damage", ["missing", "text", "cut"])
def test_what_is_no_file_of_cases_is_refused_by_its_name(tmp_path: Path, damage: str) -> None:
    path = tmp_path / "cases.npz"
    if damage == "text":
        path.write_text("hello")
    if damage == "cut":
        write_cases(path, 0, list(solved_cases(range(5), width=7, height=7, robots=3)))
        path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(ValueError, match=r"cases\.npz holds no solved cases"):
        read_cases(path)
