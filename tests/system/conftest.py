"""Teams of real processes for tests."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from magat_bringup.client import EpisodeClient, EpisodeOutcome
from magat_bringup.environment import loopback, own_domain
from magat_bringup.models import find_policy
from magat_bringup.processes import TeamPlan, TeamProcesses
from magat_interfaces.action import RunEpisode
from magat_training.cases import SET_SEED


@dataclass(frozen=True)
class RunningTeam:
    """A team, and the client that runs episodes on it."""

    processes: TeamProcesses
    client: EpisodeClient
    environment: dict[str, str]
    robots: int

    def goal(self, number: int, seed: int = SET_SEED, **fields) -> RunEpisode.Goal:
        size = {"width": 20, "height": 20, "density": 0.1, **fields}
        return RunEpisode.Goal(seed=seed, number=number, **size)

    def run(self, goal: RunEpisode.Goal, on_feedback=lambda feedback: None) -> EpisodeOutcome:
        return self.client.run(goal, on_feedback)


@pytest.fixture(scope="session")
def policy_folder() -> Path:
    """The shipped policy."""
    return find_policy("MAGAT-F-128")


@pytest.fixture(scope="session")
def start_named_team(policy_folder, tmp_path_factory):
    """A context manager: ``with start_named_team(names) as team``."""

    @contextmanager
    def start(names: list[str], ready_timeout: float = 60.0) -> Iterator[RunningTeam]:
        with own_domain() as domain:
            environment = loopback(domain)
            os.environ.update(environment)
            plan = TeamPlan(names, policy_folder, tmp_path_factory.mktemp("logs"), environment, ready_timeout)
            with TeamProcesses(plan) as processes, EpisodeClient(processes, domain) as client:
                client.wait_for_simulator()
                yield RunningTeam(processes, client, environment, len(names))

    return start


@pytest.fixture(scope="session")
def start_team(start_named_team):
    """A context manager: ``with start_team(robots) as team``."""
    return lambda robots, **options: start_named_team([f"robot_{i}" for i in range(robots)], **options)


@pytest.fixture(scope="session")
def team(start_team) -> Iterator[RunningTeam]:
    """Ten robots, shared by the tests that leave the team as they found it."""
    with start_team(10) as running:
        yield running
