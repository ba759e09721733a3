# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""``magat models``: the policies in models/, with their reports."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from magat_evaluation.candidates import bytes_per_step
from magat_evaluation.measures_file import read
from magat_evaluation.report import Report
from magat_evaluation.tables import DIGITS, table
from magat_robot.policy.backends import load_computed
from magat_robot.policy.config import ModelError, PolicyConfig
from magat_robot.policy.folder import count_weights


@dataclass(frozen=True)
class ListedPolicy:
    """A policy folder that was verified."""

    name: str
    folder: Path
    config: PolicyConfig
    #: SHA-256 of the weights, hexadecimal.
    digest: str
    #: Number of trained weights.
    weights: int
    reports: Sequence[Report]

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {
            "name": self.name,
            "folder": str(self.folder),
            "error": None,
            "policy": self.config.name,
            "digest": self.digest,
            "temperature": self.config.temperature,
            "encoding": self.config.encoding,
            "floats": sum(self.config.message_sizes),
            "bytes": bytes_per_step(self.config),
            "weights": self.weights,
            "measures": [report.to_json() | {"stale": report.stale(self.digest)} for report in self.reports],
        }


@dataclass(frozen=True)
class UnusablePolicy:
    """A policy folder that cannot be used."""

    name: str
    folder: Path
    #: Why, and what to do.
    error: str

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {"name": self.name, "folder": str(self.folder), "error": self.error}


def describe(name: str, folder: Path) -> ListedPolicy | UnusablePolicy:
    """Verify the policy in ``folder``, and read its reports."""
    try:
        policy = load_computed(folder)
        weights = count_weights(folder)
        reports = read(folder)
    except ModelError as error:
        return UnusablePolicy(name, folder, str(error))
    return ListedPolicy(name, folder, policy.config, policy.digest, weights, reports)


def listing(policies: Sequence[ListedPolicy | UnusablePolicy]) -> Group:
    """``policies`` for the terminal."""
    result = Table(box=None, pad_edge=False)
    for heading in ("policy", "digest", "T", "floats a step", "bytes", "weights", "reports"):
        result.add_column(
            heading, justify="left" if heading in ("policy", "digest", "reports") else "right", overflow="fold"
        )
    entries, problems = [], []
    for policy in policies:
        if isinstance(policy, UnusablePolicy):
            result.add_row(f"[red]{escape(policy.name)}[/]", "[red]unusable[/]")
            problems.append(Text(f"{policy.name}: {policy.error}", style="red"))
            continue
        stale = sum(report.stale(policy.digest) for report in policy.reports)
        fresh = len(policy.reports) - stale
        result.add_row(
            escape(policy.name),
            policy.digest[:DIGITS],
            f"{policy.config.temperature:g}",
            str(sum(policy.config.message_sizes)),
            str(bytes_per_step(policy.config)),
            f"{policy.weights:,}",
            f"{fresh or 'none'}" + (f"[red], {stale} stale[/]" if stale else ""),
        )
        entries += [(policy.name, policy.digest, report) for report in policy.reports]
    parts: list[RenderableType] = [result]
    if entries:
        parts += ["", table(entries)]
    if problems:
        parts += ["", *problems]
    return Group(*parts)
