"""Solved cases in a file: positions only, since observations are rebuilt from them faster than they are read."""

from collections.abc import Sequence
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from magat_sim.case import Case
from magat_training.cases import SolvedCase


def write_cases(path: Path, seed: int, solved: Sequence[SolvedCase]) -> None:
    """Write cases of one map size and one team size, drawn under ``seed``, to ``path`` (NumPy's .npz, compressed).

    The arrays in it, for C cases of N robots and S instants in all: ``seed`` ``[]``, ``number`` ``[C]``, ``shape``
    ``[2]`` (height, width), ``obstacles`` ``[C, ...]`` (bits, packed), ``goals`` ``[C, N, 2]``, ``instants`` ``[C]``
    (T + 1 of each case) and ``paths`` ``[S, N, 2]`` (case after case, the first instant the starts); cells ``(x, y)``.

    Raises:
        ValueError: no cases, or cases of different sizes.
    """
    if not solved:
        raise ValueError("no solved case: there is nothing to write")
    sizes = {(s.case.obstacles.shape, s.case.robots) for s in solved}
    if len(sizes) > 1:
        raise ValueError(f"cases of different sizes {sorted(sizes)}: write one file for each")
    draft = path.with_name(path.name + ".draft")
    path.parent.mkdir(parents=True, exist_ok=True)
    with draft.open("wb") as file:
        np.savez_compressed(
            file,
            seed=np.int64(seed),
            number=np.array([s.number for s in solved], dtype=np.int64),
            shape=np.array(solved[0].case.obstacles.shape, dtype=np.int32),
            obstacles=np.packbits([s.case.obstacles.ravel() for s in solved], axis=1),
            goals=np.stack([s.case.goals for s in solved]).astype(np.int16),
            instants=np.array([len(s.paths) for s in solved], dtype=np.int32),
            paths=np.concatenate([s.paths for s in solved]).astype(np.int16),
        )
    draft.replace(path)  # whoever reads it meanwhile gets the whole old file or the whole new one


def read_cases(path: Path) -> tuple[int, list[SolvedCase]]:
    """The seed and the cases that `write_cases` wrote to ``path``.

    Raises:
        ValueError: it is no such file.
    """
    try:
        with np.load(path, allow_pickle=False) as arrays:
            data = {name: arrays[name] for name in arrays.files}
        height, width = (int(size) for size in data["shape"])
        cells = np.unpackbits(data["obstacles"], axis=1, count=height * width).astype(bool)
        ends = np.cumsum(data["instants"])
        paths = np.split(data["paths"], ends[:-1])
    except (OSError, ValueError, KeyError, BadZipFile) as error:
        raise ValueError(f"{path} holds no solved cases ({error}): make it again") from error
    solved = [
        SolvedCase(int(number), Case(grid.reshape(height, width), way[0].astype(np.int64), goals.astype(np.int64)), way)
        for number, grid, goals, way in zip(data["number"], cells, data["goals"], paths, strict=True)
    ]
    return int(data["seed"]), solved
