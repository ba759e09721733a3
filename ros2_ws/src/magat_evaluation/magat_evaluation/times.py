# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Seconds of a policy and of the expert for each case: the paper's Table II."""

import csv
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from rich.console import Console

from magat_evaluation.candidates import Candidate
from magat_evaluation.cases import solved_cases
from magat_evaluation.claims import Verdict
from magat_evaluation.planners import evaluate_planner
from magat_evaluation.sets import TEST_SETS
from magat_evaluation.tables import markdown_table
from magat_node.files import write_atomically
from magat_node.progress import tracked
from magat_robot.policy.folder import read_folder

TIMES = "times.csv"
#: The paper's policy, and its seconds for each successful case and the expert's, by map.
PAPER_POLICY = "MAGAT-B-32-P4"
PAPER = {
    "200x200 (500)": ("510.1", "3,000 to 4,000"),
    "200x200 (1000)": ("1286.8", "33,000 to 35,000"),
    "100x100 (500)": ("279.9", "1,100 to 1,200"),
}
#: Cases of each map that are timed.
CASES = 4


@dataclass(frozen=True)
class Time:
    """CPU seconds on one map."""

    #: See `CaseSet.name`.
    map: str
    policy: str
    #: SHA-256 of the weights, hexadecimal.
    digest: str
    cases: int
    #: Cases in which every robot reached its goal.
    successes: int
    #: Of the policy, for all cases, the simulator included.
    policy_seconds: float
    #: Of the expert, for all cases.
    expert_seconds: float


def update_times(policies: Mapping[str, Path], output: Path, console: Console) -> None:
    """Measure the times, unless `PAPER_POLICY` is not among ``policies`` or ``output`` has those of all maps."""
    folder = policies.get(PAPER_POLICY)
    if folder is None:
        return
    needed = {(cases.name, read_folder(folder)[1]) for cases in TEST_SETS["large"]}
    if {(one.map, one.digest) for one in read_times(output / TIMES)} != needed:
        measure_times(folder, output, console)


def measure_times(folder: Path, output: Path, console: Console) -> list[Time]:
    """Time the policy in ``folder`` and the expert on the set large, in CPU seconds, and write `TIMES` to ``output``.

    Raises:
        InvalidCaseError: a set has no cases that can be drawn.
        ModelError: the policy cannot be used.
    """
    output.mkdir(parents=True, exist_ok=True)
    candidate = Candidate.of_policy(folder)
    times = []
    for cases in tracked(TEST_SETS["large"], "times", len(TEST_SETS["large"]), console):
        started = time.process_time()
        solved = list(solved_cases(cases.numbers[:CASES], cases.seed, workers=1, **cases.size))
        planned = time.process_time()
        planner = candidate.make_planner()
        loaded = time.process_time()
        episodes = [evaluate_planner(planner, [one], cases.seed, rules=candidate.rules)[0] for one in solved]
        spent = round(time.process_time() - loaded, 1), round(planned - started, 2)
        successes = sum(episode.success for episode in episodes)
        times.append(Time(cases.name, candidate.name, candidate.digest, len(solved), successes, *spent))
        with write_atomically(output / TIMES) as draft, draft.open("w", newline="") as file:
            writer = csv.DictWriter(file, [field.name for field in fields(Time)], lineterminator="\n")
            writer.writeheader()
            writer.writerows(map(asdict, times))
    return times


def read_times(path: Path) -> list[Time]:
    """The times that `measure_times` wrote; none if there is no such file."""
    if not path.is_file():
        return []
    with path.open(newline="") as file:
        return [
            Time(row["map"], row["policy"], row["digest"], int(row["cases"]), int(row["successes"]),
                 float(row["policy_seconds"]), float(row["expert_seconds"]))
            for row in csv.DictReader(file)
        ]  # fmt: skip


def times_table(times: Sequence[Time]) -> str:
    """Seconds for each successful case beside the paper's, in Markdown; "" without times."""
    rows = []
    for one in times:
        expert = one.expert_seconds / one.cases
        policy = one.policy_seconds / one.successes if one.successes else math.inf
        verdict = Verdict.REPRODUCED if policy < expert else Verdict.NOT_REPRODUCED
        here = (f"{one.successes} of {one.cases}", f"{policy:.1f}", f"{expert:.1f}", f"{policy / expert:.1f}")
        rows.append((one.map, one.policy, *PAPER[one.map], *here, str(verdict)))
    heading = ("map (robots)", "policy", "the paper: policy, s", "the paper: expert, s", "successful cases here",
               "here: policy, s", "here: expert, s", "policy / expert", "the policy is faster")  # fmt: skip
    return markdown_table(heading, rows) if rows else ""
