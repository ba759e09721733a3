"""Do robots attend more to robots that they are in conflict with? Usage: `python conflicts.py BAG`."""

import sys
from pathlib import Path

import matplotlib.pyplot as plt

from magat_pictures.colours import ALARM, INK, ROBOT_INKS
from magat_recording.attention import links, relative_attention
from magat_recording.tables import TeamRecording
from magat_robot.policy.models import policy_of_digest
from magat_robot.policy.store import load
from magat_sim.measures import Z_95

recording = TeamRecording(Path(sys.argv[1]))
status = recording.last_status
folder = policy_of_digest(status.digest)
if folder is None:
    sys.exit(f"the policy {status.policy} of this recording is not in models/")
heard = links(recording, load(folder))

figure, (attention, entropy) = plt.subplots(1, 2, figsize=(8, 3), layout="constrained")

# Each row of `heard` is a link, with its distance, its attention, and whether the two robots are in conflict.
for conflict, colour, label in ((True, ALARM, "in conflict"), (False, INK, "others")):
    table = relative_attention(heard[(heard.conflict == conflict) & (heard.distance <= 4)], "distance")
    look = {"color": colour, "marker": "o", "capsize": 3, "label": label}
    attention.errorbar(table.distance, table.relative, table.half_width, **look)
    print(f"{label}:\n{table.to_string(index=False)}\n")
attention.axhline(1, color="grey", linestyle="--", linewidth=0.8)
attention.set(xlabel="distance, up to (cells)", ylabel="attention, equal share = 1", xticks=range(1, 5))
attention.legend(frameon=False)

# Each row of `decisions` is a robot in a tick, with its entropy and the distance to the nearest robot that it hears.
key = ["episode", "tick", "robot"]
nearest = heard.rename(columns={"receiver": "robot"}).groupby(key).distance.min().round()
decisions = recording.robots.set_index(key).assign(nearest=nearest)
under_way = decisions[(decisions.x != decisions.goal_x) | (decisions.y != decisions.goal_y)]
groups = under_way.groupby("nearest").entropy
entropy.errorbar(groups.mean().index, groups.mean(), Z_95 * groups.sem(), color=ROBOT_INKS[0], marker="o", capsize=3)
entropy.set(xlabel="distance of the nearest robot heard (cells)", ylabel="entropy of the decision (bits)")

figure.savefig("conflicts.png", dpi=160)
