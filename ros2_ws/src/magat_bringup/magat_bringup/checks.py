# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""What `magat run` checks before it starts a process."""

from magat_bringup.run_plan import RunPlan
from magat_bringup.team import TeamPlan
from magat_recording.bag import BagError
from magat_recording.recovery import continuation
from magat_robot.policy.folder import read_folder
from magat_sim.case import InvalidCaseError, draw_case

#: Largest values of the fields of the RunEpisode action.
LARGEST_SEED, LARGEST_NUMBER, LARGEST_SIDE = 2**64 - 1, 2**32 - 1, 2**16 - 1


def check_run(plan: RunPlan, team: TeamPlan) -> None:
    """Check everything that can be checked without the team's processes.

    Args:
        plan: the episodes.
        team: the team that runs them.

    Raises:
        InvalidCaseError: seed, case numbers or size are out of range, or no such case can be drawn.
        ModelError: the policy's folder is incomplete or damaged.
        BagError: the bag to record to exists.
        TeamFileError: the parameter file does not exist.
    """
    team.check()
    team.commands()
    read_folder(team.policy)
    _check_episodes(plan, len(team.team.robots))
    bag = plan.bag(plan.output)
    if bag is not None and (bag := continuation(bag)).exists():
        raise BagError(f"the bag {bag} exists: remove it, or record to another folder")


def _check_episodes(plan: RunPlan, robots: int) -> None:
    if not 0 <= plan.seed <= LARGEST_SEED:
        raise InvalidCaseError(f"the seed {plan.seed} is out of range: give 0 to {LARGEST_SEED}")
    if not 0 <= plan.first <= LARGEST_NUMBER + 1 - plan.episodes:
        raise InvalidCaseError(
            f"the cases {plan.first} to {plan.first + plan.episodes - 1} are out of range: give 0 to {LARGEST_NUMBER}"
        )
    if max(plan.width, plan.height) > LARGEST_SIDE:
        raise InvalidCaseError(
            f"a map of {plan.width}x{plan.height} cells is too large: give at most {LARGEST_SIDE} cells a side"
        )
    if plan.scenarios is None:
        draw_case(plan.seed, plan.first, plan.width, plan.height, robots, plan.density)
