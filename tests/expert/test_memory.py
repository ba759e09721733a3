# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The memory of a search: it grows with what is searched, not with the map and the time, and its limit holds."""

import hashlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from magat_expert import InvalidInstanceError, SolveStatus, solve, solve_hca, solve_many, solve_replan
from magat_expert.node import fill_response
from magat_interfaces.srv import SolveMapf
from magat_sim.case import draw_case

PLANNERS = {"ecbs": solve, "hca": solve_hca, "replan": solve_replan}
ALL = pytest.mark.parametrize("planner", PLANNERS)
#: Digests of solutions, found when a full map of numbers was kept for each time step.
DIGESTS = json.loads((Path(__file__).parent / "digests.json").read_text())
HOPELESS = (np.zeros((2, 2), bool), [(0, 0), (1, 0), (1, 1), (0, 1)], [(1, 0), (0, 0), (1, 1), (0, 1)])

#: Runs a planner in a process of its own; prints the status, the cost, and the memory that the search added, MiB.
PROBE = """
import json, resource, sys
import numpy as np
from magat_expert import solve, solve_hca, solve_replan
planner, name, limit = sys.argv[1:]
sides = {"open": 1024, "snake": 151, "hopeless": 2}
obstacles = np.zeros((sides[name], sides[name]), bool)
last = sides[name] - 1
starts, goals = [(0, 0)], [(last, last)]
if name == "snake":
    obstacles[1::2] = True
    obstacles[1::4, -1] = obstacles[3::4, 0] = False
if name == "hopeless":
    starts, goals = [(0, 0), (1, 0), (1, 1), (0, 1)], [(1, 0), (0, 0), (1, 1), (0, 1)]
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
plan = {"ecbs": solve, "hca": solve_hca, "replan": solve_replan}[planner]
found = plan(obstacles, starts, goals, memory_limit=int(limit), time_limit=60.0)
after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(json.dumps([found.status.name, found.cost, (after - before) / 1024]))
"""


def probe(planner: str, name: str, limit: int) -> tuple[str, int, float]:
    """Status, cost and added memory (MiB) of a search in a process of its own."""
    command = [sys.executable, "-c", PROBE, planner, name, str(limit)]
    status, cost, memory = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    return status, cost, memory


def digest(solution) -> str:
    """The first digits of a hash of all that a search found, its expansions included."""
    numbers = (solution.status, solution.cost, solution.lower_bound, solution.expansions_high, solution.expansions_low)
    paths = b"" if solution.paths is None else solution.paths.tobytes()
    return hashlib.sha256(repr(tuple(map(int, numbers))).encode() + paths).hexdigest()[:16]


@ALL
@pytest.mark.parametrize("size", DIGESTS)
def test_solutions_are_those_of_full_arrays_bit_by_bit(planner, size):
    side, robots = map(int, size.split("x"))
    found = []
    for number in range(len(DIGESTS[size][planner])):
        case = draw_case(2021, number, side, side, robots, 0.1)
        limits = {"node_limit": 20_000} if planner == "ecbs" else {"seed": 7}
        found.append(digest(PLANNERS[planner](case.obstacles, case.starts, case.goals, time_limit=600.0, **limits)))
    assert found == DIGESTS[size][planner]


@ALL
@pytest.mark.parametrize(("name", "cost", "most"), [("open", 2046, 100), ("snake", 11_400, 30)])
def test_long_paths_on_large_maps_take_little_memory(planner, name, cost, most):
    """With a full map for each time step they took 12.4 GB and 1.6 GB."""
    status, found, memory = probe(planner, name, 200)
    assert (status, found) == ("SOLVED", cost)
    assert memory < most


def test_the_limit_holds():
    status, cost, memory = probe("ecbs", "hopeless", 16)
    assert (status, cost) == ("MEMORY_LIMIT", 0)
    assert memory < 16 + 24, "the allocator may keep some of what was given back"


@ALL
def test_a_map_beyond_the_limit_is_a_status_and_no_failure(planner):
    solution = PLANNERS[planner](np.zeros((600, 600), bool), [(0, 0)], [(599, 599)], memory_limit=1)
    assert solution.status is SolveStatus.MEMORY_LIMIT
    assert solution.paths is None
    assert (solution.cost, solution.makespan) == (0, 0)
    assert not solution.arrived.any()


def test_a_search_at_its_limit_keeps_its_lower_bound():
    solution = solve(*HOPELESS, memory_limit=4)
    assert solution.status is SolveStatus.MEMORY_LIMIT
    assert solution.lower_bound > solve(*HOPELESS, node_limit=10).lower_bound
    assert solution.expansions_low > solution.expansions_high > 1000


def test_many_searches_are_limited_one_by_one():
    case = draw_case(1, 0)
    hopeless = type(case)(*HOPELESS)
    found = solve_many([hopeless, case, hopeless], workers=2, memory_limit=2)
    assert [one.status.name for one in found] == ["MEMORY_LIMIT", "SOLVED", "MEMORY_LIMIT"]


@ALL
@pytest.mark.parametrize("limit", [0, -1, 1.5, 2**21])
def test_senseless_limits_are_refused(planner, limit):
    with pytest.raises(InvalidInstanceError, match="memory_limit is"):
        PLANNERS[planner](*HOPELESS, memory_limit=limit)


def test_the_service_says_which_limit_it_was():
    response = SolveMapf.Response()
    fill_response(response, solve(*HOPELESS, memory_limit=1), time_limit=60.0, memory_limit=1)
    assert response.status == SolveMapf.Response.TIMED_OUT
    assert response.message.startswith("not solved within 1 MiB")
