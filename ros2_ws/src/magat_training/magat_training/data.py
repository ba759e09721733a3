# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Data sets: folders of solved cases, with the same contents on every machine.

A folder holds shards ``{split}-{number of the first case:05d}.npz`` and, once it is complete, ``manifest.json``. Shards
store maps, starts, goals and actions; observations are recomputed, which is faster than reading them. A shard contains
the recipe of its data set and is written atomically, so that a command that was killed at any moment can be resumed.

The manifest is one JSON object:

- ``recipe``: what determines the contents. ``generator_version``, ``seed``, ``size`` (width and height in cells,
  robots, density), ``expert`` (its bound w and its limit in high-level expansions), ``splits`` (for each its first
  number and the number after its last), ``shard`` (cases in each file).
- ``splits``: the result. For each split how many cases were ``drawn`` and ``solved``, the numbers of the ``unsolved``
  ones, which are not stored, ``instants`` (the sum of T + 1 over the cases), and ``shards``, the SHA-256 of each.
- ``sha256``: of all the above.

Hashes are those of arrays, not of files: they do not depend on the compression.
"""

import hashlib
import io
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from magat_evaluation.cases import GENERATOR_VERSION, SolvedCase, solved_cases
from magat_evaluation.splits import EXPERT_NODE_LIMIT, EXPERT_W, SET_SEED, SET_SIZE, SPLITS
from magat_node.errors import MagatError
from magat_node.files import write_atomically
from magat_sim.case import Case
from magat_sim.grid import DELTAS, primitives_between

MANIFEST = "manifest.json"
#: Cases in each file: half a second of work, which is lost in an interruption.
SHARD_CASES = 1_500


class DataSetError(MagatError, ValueError):
    """A data set cannot be made or read; the message says why and what to do."""


def make_data_set(
    folder: Path,
    seed: int = SET_SEED,
    splits: Mapping[str, range] = SPLITS,
    size: Mapping[str, float] = SET_SIZE,
    workers: int = 2,
    shard: int = SHARD_CASES,
    progress: Callable[[int], None] = lambda done: None,
    executor: Executor | None = None,
) -> dict[str, Any]:
    """Draw and solve cases into ``folder``, or resume where that was interrupted; damaged shards are made again.

    Args:
        folder: of the data set; created if it does not exist.
        seed: of the series of cases, 0 or more.
        splits: the contiguous numbers of each split, by name.
        size: any of width, height (cells), robots and density, as `draw_case` takes them.
        workers: solver threads; the data set does not depend on their number.
        shard: cases in each file, at least 1.
        progress: called repeatedly with the number of cases done, including those found in ``folder``. It may raise an
            exception to stop.
        executor: solves the cases, a shard at a time; threads of this process if None.

    Returns:
        The manifest.

    Raises:
        DataSetError: the folder holds cases of another recipe, two cases are equal, or a parameter is out of range.
        InvalidCaseError: no case of this size can be drawn.
        OSError: the folder cannot be written.
    """
    recipe = _recipe(seed, splits, size, shard)
    _check_recipes(folder, recipe)
    submitted = {} if executor is None else _submit(executor, folder, seed, splits, recipe)
    summaries = {}
    seen: dict[bytes, str] = {}
    done = 0
    for split, numbers in splits.items():
        summary: dict[str, Any] = {"drawn": len(numbers), "solved": 0, "unsolved": [], "instants": 0, "shards": {}}
        for part in _parts(numbers, shard):
            path = _shard_path(folder, split, part)
            solved, digest = _whole_shard(path)
            if not digest and path in submitted:
                solved = submitted[path].result()
            elif not digest:
                for case in solved_cases(part, seed, workers, **recipe["size"]):
                    solved.append(case)
                    progress(done + part.index(case.number) + 1)
            _check_distinct(split, solved, seen)
            if not digest:
                digest = _write_shard(path, recipe, solved)
            summary["solved"] += len(solved)
            summary["unsolved"] += sorted(set(part) - {case.number for case in solved})
            summary["instants"] += sum(len(case.paths) for case in solved)
            summary["shards"][path.name] = digest
            done += len(part)
            progress(done)
        summaries[split] = summary
    manifest: dict[str, Any] = {"recipe": recipe, "splits": summaries}
    manifest["sha256"] = _manifest_digest(manifest)
    _write(folder / MANIFEST, (json.dumps(manifest, indent=2) + "\n").encode())
    return manifest


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of the data set in ``folder``, its own hash verified.

    Raises:
        DataSetError: there is none, it is damaged, or it is of another version of the generator.
    """
    path = folder / MANIFEST
    try:
        manifest = json.loads(path.read_text())
        version, digest = manifest["recipe"]["generator_version"], manifest["sha256"]
        intact = digest == _manifest_digest(manifest)
    except FileNotFoundError:
        raise DataSetError(
            f"{folder} has no {MANIFEST}: make the data set, or complete it, with `magat data make`"
        ) from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataSetError(f"{path} is no manifest ({error!r}): make the data set again") from error
    if version != GENERATOR_VERSION:
        raise DataSetError(
            f"{folder} was made by version {version} of the generator, and this is version {GENERATOR_VERSION}: delete "
            "the folder and make the data set again"
        )
    if not intact:
        raise DataSetError(f"{path} does not match its own hash {digest}: make the data set again")
    return manifest


def read_data_set(folder: Path, split: str) -> list[SolvedCase]:
    """The solved cases of one split of the data set in ``folder``, by number, their hashes verified.

    Raises:
        DataSetError: no such split; or anything is missing, damaged, or of another version of the generator.
    """
    splits = read_manifest(folder)["splits"]
    if split not in splits:
        raise DataSetError(f"{folder} has no split {split!r}: it has {', '.join(splits)}")
    solved = []
    for name, expected in splits[split]["shards"].items():
        cases, digest = _read_shard(folder / name)
        if digest != expected:
            raise DataSetError(
                f"{folder / name} has the hash {digest}, but {expected} in the manifest: delete it and make the data "
                "set again"
            )
        solved += cases
    return solved


def check_data_set(folder: Path) -> dict[str, Any]:
    """The manifest of the data set in ``folder``, after verifying every hash and that no two cases are equal.

    Raises:
        DataSetError: as `read_data_set`; or two cases are equal.
    """
    manifest = read_manifest(folder)
    seen: dict[bytes, str] = {}
    for split in manifest["splits"]:
        _check_distinct(split, read_data_set(folder, split), seen)
    return manifest


def _parts(numbers: range, shard: int) -> list[range]:
    """The numbers of each shard."""
    return [numbers[first : first + shard] for first in range(0, len(numbers), shard)]


def _shard_path(folder: Path, split: str, part: range) -> Path:
    return folder / f"{split}-{part.start:05d}.npz"


def _submit(
    executor: Executor, folder: Path, seed: int, splits: Mapping[str, range], recipe: Mapping[str, Any]
) -> dict[Path, Future[list[SolvedCase]]]:
    """Let ``executor`` solve the cases of all shards that are missing or damaged."""
    parts = {
        _shard_path(folder, split, part): part
        for split, numbers in splits.items()
        for part in _parts(numbers, recipe["shard"])
    }
    return {
        path: executor.submit(_solve, part, seed, recipe["size"])
        for path, part in parts.items()
        if not _whole_shard(path)[1]
    }


def _solve(numbers: range, seed: int, size: Mapping[str, float]) -> list[SolvedCase]:
    return list(solved_cases(numbers, seed, workers=1, **size))


def _recipe(seed: int, splits: Mapping[str, range], size: Mapping[str, float], shard: int) -> dict[str, Any]:
    if seed < 0 or shard < 1:
        raise DataSetError(f"seed {seed}, {shard} cases a shard: give a seed of at least 0, and at least 1 case")
    for split, numbers in splits.items():
        if numbers.step != 1 or not numbers:
            raise DataSetError(f"the split {split} has the numbers {numbers}: give at least one, without gaps")
    return {
        "generator_version": GENERATOR_VERSION,
        "seed": seed,
        # In their own types: 0 and 0.0 are the same density, and must give the same hash.
        "size": {name: type(SET_SIZE[name])(value) for name, value in {**SET_SIZE, **size}.items()},
        "expert": {"w": EXPERT_W, "node_limit": EXPERT_NODE_LIMIT},
        "splits": {split: [numbers.start, numbers.stop] for split, numbers in splits.items()},
        "shard": shard,
    }


def _check_recipes(folder: Path, recipe: dict[str, Any]) -> None:
    for path in sorted(folder.glob("*.npz")):
        try:
            found = json.loads(_arrays(path, "recipe")["recipe"].tobytes())
        except ValueError:
            continue  # no shard, or a damaged one
        other = [name for name in recipe if found.get(name) != recipe[name]]
        if other:
            raise DataSetError(
                f"{folder} holds cases made with {'; '.join(f'{name} {found.get(name)}' for name in other)}; now it is "
                f"{'; '.join(f'{name} {recipe[name]}' for name in other)}: choose another folder, or delete this one"
            )


def _check_distinct(split: str, solved: Iterable[SolvedCase], seen: dict[bytes, str]) -> None:
    """Add the contents of ``solved`` to ``seen``; raises an error if one of them is there already, in any split."""
    for one in solved:
        content = hashlib.sha256()
        for part in (one.case.obstacles, one.case.starts, one.case.goals):
            content.update(part.tobytes())
        name = f"case {one.number} ({split})"
        other = seen.setdefault(content.digest(), name)
        if other is not name:
            raise DataSetError(
                f"{name} equals {other}, and no case may occur twice: choose splits that do not overlap, "
                "larger maps or fewer cases"
            )


def _whole_shard(path: Path) -> tuple[list[SolvedCase], str]:
    """The shard in ``path``, or no cases and no digest if it is missing or damaged."""
    try:
        return _read_shard(path)
    except DataSetError:
        return [], ""


def _write_shard(path: Path, recipe: dict[str, Any], solved: Sequence[SolvedCase]) -> str:
    """Write C cases of N robots to ``path`` (NumPy's .npz, compressed), and return the SHA-256 of the arrays.

    ``recipe`` (bytes of JSON), ``number`` ``[C]``, ``obstacles`` ``[C, ...]`` (bits of ``[H, W]``, packed), ``starts``
    and ``goals`` ``[C, N, 2]`` (cells ``(x, y)``), ``steps`` ``[C]`` (T), and ``actions`` ``[sum of steps, N]`` (the
    expert's primitives, case after case).
    """
    size = recipe["size"]
    cells, team = (len(solved), size["height"] * size["width"]), (len(solved), size["robots"], 2)
    still = np.empty((0, *team[1:]), dtype=np.int16)  # for a shard without a solved case
    before, after = (np.concatenate([still, *(s.paths[part] for s in solved)]) for part in (slice(-1), slice(1, None)))
    arrays = {
        "recipe": np.frombuffer(json.dumps(recipe).encode(), dtype=np.uint8),
        "number": np.array([s.number for s in solved], dtype="<i8"),
        "obstacles": np.packbits(np.array([s.case.obstacles for s in solved], dtype=bool).reshape(cells), axis=1),
        "starts": np.array([s.case.starts for s in solved], dtype="<i2").reshape(team),
        "goals": np.array([s.case.goals for s in solved], dtype="<i2").reshape(team),
        "steps": np.array([len(s.paths) - 1 for s in solved], dtype="<i4"),
        "actions": primitives_between(before, after).astype(np.uint8),
    }
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
    _write(path, file.getvalue())
    return _digest(arrays)


def _read_shard(path: Path) -> tuple[list[SolvedCase], str]:
    """The cases that `_write_shard` wrote to ``path``, and the SHA-256 of the arrays.

    Raises:
        DataSetError: it is missing, damaged or something else.
    """
    arrays = _arrays(path, "recipe", "number", "obstacles", "starts", "goals", "steps", "actions")
    size = json.loads(arrays["recipe"].tobytes())["size"]
    shape = (-1, size["height"], size["width"])
    grids = np.unpackbits(arrays["obstacles"], axis=1, count=shape[1] * shape[2]).reshape(shape).astype(bool)
    starts, goals = arrays["starts"].astype(np.int64), arrays["goals"].astype(np.int64)
    moves = np.split(DELTAS[arrays["actions"]], np.cumsum(arrays["steps"]))  # and one more, which is empty
    solved = [
        SolvedCase(int(number), Case(grid, start, goal), np.concatenate([start[None], move]).cumsum(0, dtype=np.int16))
        for number, grid, start, goal, move in zip(arrays["number"], grids, starts, goals, moves, strict=False)
    ]
    return solved, _digest(arrays)


def _arrays(path: Path, *names: str) -> dict[str, NDArray]:
    """Arrays of a shard; the checksums in the file are verified.

    Raises:
        DataSetError: it is missing, damaged or something else.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in names}
    except Exception as error:  # damage shows in many ways: zipfile, zlib and numpy all have errors of their own
        raise DataSetError(f"{path} holds no solved cases ({error!r}): make the data set again") from error


def _digest(arrays: Mapping[str, NDArray]) -> str:
    content = hashlib.sha256()
    for name in sorted(arrays):
        content.update(f"{name} {arrays[name].dtype.str} {arrays[name].shape} ".encode())
        content.update(arrays[name].tobytes())
    return content.hexdigest()


def _manifest_digest(manifest: Mapping[str, Any]) -> str:
    content = {name: value for name, value in manifest.items() if name != "sha256"}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _write(path: Path, content: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with write_atomically(path) as draft:
        draft.write_bytes(content)
