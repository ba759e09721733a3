# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Candidates: what is evaluated, a policy in a setting or a baseline."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from magat_evaluation.baselines import BASELINES
from magat_evaluation.cases import GENERATOR_VERSION
from magat_evaluation.planners import Planner, policy_planner
from magat_evaluation.report import EvaluationKey
from magat_evaluation.sets import CaseSet
from magat_node import cdr
from magat_robot.policy.backends import load_computed
from magat_robot.policy.config import PolicyConfig
from magat_robot.policy.folder import read_folder, read_temperature
from magat_robot.policy.payload import encoded_bytes
from magat_sim.shield import SHIELD_VERSIONS
from magat_sim.simulator import DEFAULT_RULES, Rules


@dataclass(frozen=True)
class Setting:
    """How a policy is run, on whatever cases."""

    #: For sampling; the policy's own with this shield if None.
    temperature: float | None = None
    #: Of messages; the policy's own if empty.
    encoding: str = ""
    #: Of the worlds.
    rules: Rules = DEFAULT_RULES
    #: See `PolicyConfig`; the policy's own if None.
    visit_memory: float | None = None

    @property
    def changes(self) -> dict[str, Any]:
        """What differs from the policy's own configuration, as `PolicyConfig.with_changes` takes it."""
        given = {
            "temperature": self.temperature,
            "encoding": self.encoding or None,
            "visit_memory": self.visit_memory,
        }
        return {name: value for name, value in given.items() if value is not None}


DEFAULT_SETTING = Setting()


@dataclass(frozen=True)
class Candidate:
    """A policy in a setting, or a baseline."""

    #: In tables and pictures.
    name: str
    #: SHA-256 of the weights, hexadecimal; "" for a baseline.
    digest: str
    temperature: float
    encoding: str
    rules: Rules
    #: What a robot sends in a step.
    bytes_per_step: int
    #: Loads the weights, if there are any.
    make_planner: Callable[[], Planner] = field(compare=False)
    #: Of the policy's configuration.
    visit_memory: float = 0.0

    @classmethod
    def of_policy(cls, folder: Path, setting: Setting = DEFAULT_SETTING, name: str = "") -> "Candidate":
        """The policy in ``folder``, called by the paper's name if ``name`` is empty.

        Raises:
            ModelError: it cannot be used, or not in this setting.
        """
        config, digest, _ = read_folder(folder)
        changes = {"temperature": read_temperature(folder, setting.rules.shield)} | setting.changes
        config = config.with_changes(**changes)

        def make_planner() -> Planner:
            return policy_planner(load_computed(folder, **changes))

        conditions = (config.temperature, config.encoding, setting.rules)
        sent = bytes_per_step(config)
        return cls(name or config.name, digest, *conditions, sent, make_planner, config.visit_memory)

    @classmethod
    def of_baseline(cls, name: str, shield: str | None = None) -> "Candidate":
        """One of the `BASELINES`; it has no weights, messages and temperature.

        Args:
            name: of the baseline.
            shield: one of the baseline's shields; the first of them if None.
        """
        planner, shields = BASELINES[name]
        return cls(name, "", 0.0, "", Rules(shield=shield or shields[0]), 0, lambda: planner)

    def key(self, cases: CaseSet) -> EvaluationKey:
        """What identifies its evaluation on ``cases``."""
        return EvaluationKey(
            policy=self.name,
            digest=self.digest,
            temperature=self.temperature,
            encoding=self.encoding,
            link_loss=self.rules.link_loss,
            shield=self.rules.shield,
            shield_version=SHIELD_VERSIONS[self.rules.shield],
            width=cases.width,
            height=cases.height,
            robots=cases.robots,
            density=cases.density,
            expert_w=cases.expert_w,
            generator_version=GENERATOR_VERSION,
            seed=cases.seed,
            first_case=cases.numbers[0],
            cases=cases.cases,
            visit_memory=self.visit_memory,
        )


def bytes_per_step(config: PolicyConfig) -> int:
    """Bytes of the feature messages that a robot sends in a step, headers included, all rounds together."""
    return cdr.feature_bytes(encoded_bytes(size, config.encoding) for size in config.message_sizes)
