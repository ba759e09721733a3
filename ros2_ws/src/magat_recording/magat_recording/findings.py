# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The results of ``magat analyze``: measures, timing, attention and deadlocks of a recorded team."""

from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from rich.console import Console

from magat_recording.attention import attention_received, effective_neighbours, links, relative_attention
from magat_recording.deadlocks import deadlocks
from magat_recording.tables import TeamRecording
from magat_robot.policy.backends import load_computed
from magat_robot.policy.computed import ComputedPolicy
from magat_robot.policy.config import ModelError
from magat_robot.policy.models import find_policy, policy_of_digest

#: Percentiles of a tick's wall time that are reported.
PERCENTILES = {"p50": 0.5, "p90": 0.9, "p99": 0.99, "max": 1.0}
#: Robots in conflict are at most this far apart, cells. Their attention is compared with that at the same distances.
CONFLICT_DISTANCE = 2


@dataclass(frozen=True)
class Findings:
    """The results of the analysis of one recording."""

    recording: TeamRecording
    #: The policy that the robots carried; None if it is not known.
    policy: ComputedPolicy | None
    #: Why there is no attention; empty if there is.
    no_attention: str
    #: With attention if the policy is known and its robots communicate.
    links: pd.DataFrame
    deadlocks: pd.DataFrame

    @property
    def attention(self) -> dict[str, pd.DataFrame]:
        """Attention by distance, number of neighbours and conflict; empty if there is none."""
        if "attention" not in self.links:
            return {}
        near = self.links[self.links.distance <= CONFLICT_DISTANCE]
        return {
            "distance": relative_attention(self.links, "distance"),
            "neighbours": effective_neighbours(self.links),
            "conflict": relative_attention(near, "conflict"),
        }

    @property
    def traffic(self) -> pd.DataFrame:
        """One row for each robot.

        Columns: ``name``; ``messages`` and ``bytes`` that it sent in episodes; ``silent`` (ticks); ``slowest`` (share
        of the ticks in which it answered last); ``latency_p50``, ``latency_p99`` (seconds); ``entropy`` (bits);
        ``attention_received`` if there is attention.
        """
        recording = self.recording
        in_ticks = recording.messages[recording.messages.tick >= 0]
        sent = in_ticks[in_ticks.kind.isin(["Feature", "Preference"])].groupby("robot").bytes.agg(["count", "sum"])
        robots = recording.robots.groupby("robot")
        table = pd.DataFrame({"name": recording.names})
        table["messages"], table["bytes"] = sent["count"], sent["sum"]
        table["silent"] = robots.silent.sum()
        table["slowest"] = recording.ticks.slowest.value_counts(normalize=True)
        table["latency_p50"], table["latency_p99"] = (robots.latency.quantile(q) for q in (0.5, 0.99))
        table["entropy"] = robots.entropy.mean()
        if "attention" in self.links:
            table["attention_received"] = attention_received(self.links)
        counts = {"messages": 0, "bytes": 0, "silent": 0, "slowest": 0.0}
        return table.fillna(counts).astype({"messages": int, "bytes": int, "silent": int})


def analyze(bag: Path, policy: str | None, console: Console) -> Findings:
    """Read and analyse ``bag``.

    Args:
        bag: folder or file.
        policy: name or folder of the robots' policy; found by its digest if None.
        console: shows the progress.

    Raises:
        BagError: the bag cannot be read, or its features are not those of the policy.
        ModelError: there is no policy ``policy``.
    """
    with console.status(f"reading {bag}"):
        recording = TeamRecording(bag)
    carried, no_attention = attention_policy(recording, policy)
    with console.status("computing attention"):
        return Findings(recording, carried, no_attention, links(recording, carried), deadlocks(recording.robots))


def attention_policy(recording: TeamRecording, name: str | None) -> tuple[ComputedPolicy | None, str]:
    """The policy that the robots carried, and why there is no attention (empty if there is).

    Args:
        recording: of the team.
        name: name or folder of the policy; found by its digest if None.

    Raises:
        ModelError: there is no policy ``name``.
    """
    policy, unknown = _carried_policy(recording, name)
    if policy is None or policy.config.communicates:
        return policy, unknown
    return policy, f"robots with {policy.config.name} and K = 1 do not communicate"


def _carried_policy(recording: TeamRecording, name: str | None) -> tuple[ComputedPolicy | None, str]:
    if name is not None:
        return load_computed(find_policy(name)), ""
    status = recording.last_status
    if status is None:
        return None, "the recording has no robot_status: name the policy with --policy"
    if len(recording.policies) > 1:
        several = ", ".join(f"{carried} ({digest[:12]})" for digest, carried in recording.policies.items())
        return None, f"the robots carried several policies, {several}: record each of them separately"
    folder = policy_of_digest(status.digest)
    if folder is None:
        missing = f"{status.policy} ({status.digest[:12]})"
        return None, f"there is no policy {missing} in the folders of models: name its folder with --policy"
    try:
        return load_computed(folder), ""
    except ModelError as error:
        return None, str(error)
