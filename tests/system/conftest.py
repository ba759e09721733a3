# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Teams of real processes for tests."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest
import yaml
from team_secret import SECRET

from magat_bringup.client import EpisodeClient, EpisodeOutcome
from magat_bringup.environment import LOOPBACK, Network, own_domain
from magat_bringup.processes import TeamProcesses
from magat_bringup.team import Command, TeamFile, TeamPlan
from magat_evaluation.splits import SET_SEED
from magat_interfaces.action import RunEpisode
from magat_interfaces.msg import RobotStatus
from magat_node import qos
from magat_robot.policy.models import find_policy


@dataclass(frozen=True)
class RunningTeam:
    """A team, and the client that runs episodes on it."""

    processes: TeamProcesses
    client: EpisodeClient
    environment: dict[str, str]
    robots: int
    #: What the processes have said: their names, and lines.
    said: list[tuple[str, str]]

    def has_said(self, process: str, words: str) -> bool:
        """Whether a line of ``process`` contains ``words``."""
        return any(name == process and words in line for name, line in self.said)

    def goal(self, number: int, seed: int = SET_SEED, **fields) -> RunEpisode.Goal:
        size = {"width": 20, "height": 20, "density": 0.1, "secret": SECRET, **fields}
        return RunEpisode.Goal(seed=seed, number=number, **size)

    def run(self, goal: RunEpisode.Goal, on_feedback=lambda feedback: None) -> EpisodeOutcome:
        return self.client.run(goal, on_feedback)

    def run_undisturbed(self, goal: RunEpisode.Goal) -> EpisodeOutcome:
        """As `run`, repeated if a message came too late, which can happen on a busy machine."""
        for _ in range(3):
            outcome = self.run(goal)
            if (outcome.result.silent, outcome.result.features_missing) == (0, 0):
                break
        return outcome

    def statuses(self) -> dict[str, RobotStatus]:
        """The current status of the process of each robot."""
        said: dict[str, RobotStatus] = {}

        def note(status: RobotStatus) -> None:
            said.update(dict.fromkeys(status.robots, status))

        subscription = self.client.node.create_subscription(RobotStatus, "/robot_status", note, qos.reliable(100))
        assert self.client.spin(lambda: len(said) >= self.robots, 20.0), f"only {sorted(said)} said anything"
        self.client.node.destroy_subscription(subscription)
        return said


@dataclass(frozen=True)
class FaultyPlan(TeamPlan):
    """A team behind a bad network."""

    #: By the last part of a topic's name: see `bad_network`.
    faults: dict[str, dict[str, float]] = field(default_factory=dict)

    def commands(self) -> list[Command]:
        """As `TeamPlan.commands`, of robots and simulator started by `bad_network`."""
        faulty = ("robots", "simulator") if self.faults else ()
        return [self._behind(command) if command.name in faulty else command for command in super().commands()]

    def _behind(self, command: Command) -> Command:
        arguments = (json.dumps(self.faults), command.module, *command.arguments)
        return replace(command, module="bad_network", arguments=arguments)


@pytest.fixture(scope="session")
def policy_folder() -> Path:
    """The shipped policy."""
    return find_policy("MAGAT-F-128")


@pytest.fixture(scope="session")
def start_named_team(policy_folder, tmp_path_factory):
    """A context manager: ``with start_named_team(names) as team``."""

    @contextmanager
    def start(
        names: list[str],
        policy: Path = policy_folder,
        crew: int = 1,
        faults: dict[str, dict[str, float]] | None = None,
        parameters: dict[str, dict[str, float]] | None = None,
        **options,
    ) -> Iterator[RunningTeam]:
        with own_domain() as domain:
            logs = tmp_path_factory.mktemp("logs")
            if parameters:
                options["params"] = logs / "parameters.yaml"
                by_node = {f"/**/{node}": {"ros__parameters": values} for node, values in parameters.items()}
                options["params"].write_text(yaml.safe_dump(by_node))
            plan = FaultyPlan(TeamFile(tuple(names), crew), policy, faults=faults or {}, **options)
            environment = Network(domain, LOOPBACK if plan.server else "").variables
            os.environ.update(environment)
            importable = {"PYTHONPATH": f"{Path(__file__).parent}:{os.environ.get('PYTHONPATH', '')}"}
            said: list[tuple[str, str]] = []
            with (
                TeamProcesses(plan, logs, environment | importable, lambda *line: said.append(line)) as processes,
                EpisodeClient(processes, domain) as client,
            ):
                client.wait_for_simulator(plan.patience)
                yield RunningTeam(processes, client, environment, len(names), said)

    return start


@pytest.fixture(scope="session")
def start_team(start_named_team):
    """A context manager: ``with start_team(robots) as team``."""
    return lambda robots, **options: start_named_team([f"robot_{i}" for i in range(robots)], **options)


@pytest.fixture(scope="session")
def team(start_team) -> Iterator[RunningTeam]:
    """Ten robots that hear each other, shared by the tests that leave the team as they found it."""
    with start_team(10) as running:
        yield running


@pytest.fixture(scope="session")
def relayed_team(start_team) -> Iterator[RunningTeam]:
    """Ten robots that hear each other through the simulator, shared in the same way."""
    with start_team(10, radio="relayed") as running:
        yield running
