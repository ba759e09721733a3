"""``magat analyze``: what a recording says of a team, as tables and pictures."""

from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from rich.console import Console

from magat_recording.attention import links, listened_to, preference_for, received
from magat_recording.tables import TeamRecording, deadlocks
from magat_robot.policy.config import ModelError
from magat_robot.policy.models import find_policy, policy_of_digest
from magat_robot.policy.policy import Policy
from magat_robot.policy.store import load

#: Of a tick's wall time.
PERCENTILES = {"p50": 0.5, "p90": 0.9, "p99": 0.99, "max": 1.0}
#: Conflicts are between robots at most so far apart, cells; attention to others is compared at the same distances.
CONFLICT_DISTANCE = 2


@dataclass(frozen=True)
class Findings:
    """All that is shown of a recording."""

    recording: TeamRecording
    #: The policy that the robots carried, or None, and then why it is not known.
    policy: Policy | None
    why: str
    #: With attention if the policy is known and its robots talk.
    links: pd.DataFrame
    deadlocks: pd.DataFrame

    @property
    def attention(self) -> dict[str, pd.DataFrame]:
        """Attention by distance, density and conflict; empty if it is not known."""
        if "attention" not in self.links:
            return {}
        near = self.links[self.links.distance <= CONFLICT_DISTANCE]
        return {
            "distance": preference_for(self.links, "distance"),
            "neighbours": listened_to(self.links),
            "conflict": preference_for(near, "conflict"),
        }

    @property
    def traffic(self) -> pd.DataFrame:
        """One row a robot: what it sent in episodes, how it answered, and how much it was listened to."""
        recording = self.recording
        of_ticks = recording.messages[recording.messages.tick >= 0]
        sent = of_ticks[of_ticks.kind.isin(["Feature", "Preference"])].groupby("robot").bytes.agg(["count", "sum"])
        robots = recording.robots.groupby("robot")
        table = pd.DataFrame({"name": recording.names})
        table["messages"], table["bytes"] = sent["count"], sent["sum"]
        table["silent"] = robots.silent.sum()
        table["slowest"] = recording.ticks.slowest.value_counts(normalize=True)
        table["latency_p50"], table["latency_p99"] = (robots.latency.quantile(q) for q in (0.5, 0.99))
        table["entropy"] = robots.entropy.mean()
        if "attention" in self.links:
            table["attention_received"] = received(self.links)
        counts = {"messages": 0, "bytes": 0, "silent": 0, "slowest": 0.0}
        return table.fillna(counts).astype({"messages": int, "bytes": int, "silent": int})


def analyze(bag: Path, policy: str | None, console: Console) -> Findings:
    """Read ``bag``, and find out what is in it.

    Args:
        bag: folder or file.
        policy: name or folder of what the robots carried; found by its digest if None.
        console: shows what goes on.

    Raises:
        BagError: it cannot be read, or the features in it are not the policy's.
        ModelError: there is no policy ``policy``.
    """
    with console.status(f"reading {bag}"):
        recording = TeamRecording(bag)
    carried, why = carried_policy(recording, policy)
    if carried is not None and not carried.config.communicates:
        why = f"robots with {carried.config.name} and K = 1 do not communicate"
    with console.status("computing attention"):
        return Findings(recording, carried, why, links(recording, carried), deadlocks(recording.robots))


def carried_policy(recording: TeamRecording, name: str | None) -> tuple[Policy | None, str]:
    """The policy that robots carried: ``name``, or by its digest if None; or None, and why it is not known.

    Raises:
        ModelError: there is no policy ``name``.
    """
    if name is not None:
        return load(find_policy(name)), ""
    if recording.equipment is None:
        return None, "the recording has no robot_status: name the policy by --policy"
    if len(recording.policies) > 1:
        several = ", ".join(f"{carried} ({digest[:12]})" for digest, carried in recording.policies.items())
        return None, f"the robots carried {several}: record each for itself"
    digest = recording.equipment.digest
    folder = policy_of_digest(digest)
    if folder is None:
        what = f"{recording.equipment.policy} ({digest[:12]})"
        return None, f"there is no policy {what} in the folders of models: name its folder by --policy"
    try:
        return load(folder), ""
    except ModelError as error:
        return None, str(error)
