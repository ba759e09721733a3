"""Do robots listen to whom they are about to run into? What a recording says of it: `python conflicts.py BAG`."""

import sys
from pathlib import Path

import matplotlib.pyplot as plt

from magat_recording.attention import links, preference_for
from magat_recording.tables import TeamRecording
from magat_robot.policy.models import policy_of_digest
from magat_robot.policy.store import load

recording = TeamRecording(Path(sys.argv[1]))
folder = policy_of_digest(recording.equipment.digest)
if folder is None:
    sys.exit(f"the policy {recording.equipment.policy} of this recording is not in models/")
heard = links(recording, load(folder))

figure, (attention, entropy) = plt.subplots(1, 2, figsize=(8, 3), layout="constrained")

# A link a row: whom a robot hears, from how far, how much, and whether both want the same cell, or each other's.
for conflict, colour, label in ((True, "#e03131", "in conflict"), (False, "#2b3440", "others")):
    table = preference_for(heard[(heard.conflict == conflict) & (heard.distance <= 4)], "distance")
    look = {"color": colour, "marker": "o", "capsize": 3, "label": label}
    attention.errorbar(table.distance, table.relative, table.half_width, **look)
    print(f"{label}:\n{table.to_string(index=False)}\n")
attention.axhline(1, color="grey", linestyle="--", linewidth=0.8)
attention.set(xlabel="distance, up to (cells)", ylabel="attention, all alike = 1", xticks=range(1, 5))
attention.legend(frameon=False)

# A robot and tick a row: joined with its nearest neighbour, it says how sure the robot was in whose company.
key = ["episode", "tick", "robot"]
nearest = heard.rename(columns={"receiver": "robot"}).groupby(key).distance.min().round()
decisions = recording.robots.set_index(key).assign(nearest=nearest)
under_way = decisions[(decisions.x != decisions.goal_x) | (decisions.y != decisions.goal_y)]
groups = under_way.groupby("nearest").entropy
entropy.errorbar(groups.mean().index, groups.mean(), 1.96 * groups.sem(), color="#2f6fde", marker="o", capsize=3)
entropy.set(xlabel="distance of the nearest robot heard (cells)", ylabel="entropy of the decision (bits)")

figure.savefig("conflicts.png", dpi=160)
