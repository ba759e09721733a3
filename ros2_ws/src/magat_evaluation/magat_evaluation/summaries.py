# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tables that sum up what was measured: the aims, what messages are worth, and what two trainings differ by."""

from magat_evaluation.claims import Verdict, level, shown
from magat_evaluation.comparison import Estimate
from magat_evaluation.family import REPEATED
from magat_evaluation.measured import IDLE, Condition, Measured
from magat_evaluation.paper import DENSER, POLICIES, SAME
from magat_evaluation.sets import FULL_MAPS
from magat_evaluation.tables import markdown_table
from magat_sim.shield import SHIELDS

#: The aims: what is measured, on which maps, the bound, and whether it is an upper one.
AIMS = (
    ("alpha", tuple(dict.fromkeys((*SAME, *DENSER))), 0.985, False),
    ("delta_ft", SAME, 0.05, True),
    ("delta_ft", ("50x50 (100)",), 0.07, True),
    ("alpha", ("200x200 (1000)",), 0.90, False),
)
_AIM_HEADING = ("policy", "alpha >= 0.985, same- and increasing-density", "delta_FT <= 0.05, same-density",
                "delta_FT <= 0.07, 50x50 (100)", "alpha >= 0.90, 200x200 (1000)")  # fmt: skip
_AIM_WORDS = {
    Verdict.REPRODUCED: "reached",
    Verdict.NOT_SHOWN: "not shown",
    Verdict.NOT_REPRODUCED: "missed",
    Verdict.NOT_MEASURED: "",
}
#: Where the effect of messages is shown.
MUTE_MAPS = ("20x20 (10)", "50x50 (60)", "65x65 (100)", "50x50 (100)", "100x100 (500)", "200x200 (1000)")
#: The controls beside a mute policy: one that was trained without messages, and one without a network.
SILENT, GREEDY = "MAGAT-F-128-K1", "greedy"
_MEASURES = (("alpha", "alpha"), ("delta_ft", "delta_FT, first"), ("delta_ft_strict", "delta_FT, last"))


def aims_table(measured: Measured) -> str:
    """Which policies reach the aims with the shield idle, in Markdown; "" if nothing was measured."""
    rows = []
    for policy in POLICIES:
        found = [level(measure, policy, maps, bound, at_most)(measured) for measure, maps, bound, at_most in AIMS]
        if any(finding.text for finding in found):
            cells = (": ".join(filter(None, (_AIM_WORDS[one.verdict], one.text))) for one in found)
            rows.append((policy, *cells))
    return markdown_table(_AIM_HEADING, rows) if rows else ""


def best_policy(measured: Measured) -> str | None:
    """The policy with the highest alpha - delta_FT, on average over the maps of both sets that were measured of it."""
    scores: dict[str, float] = {}
    for policy in POLICIES:
        found = [report for place in {*SAME, *DENSER} if (report := measured.report(policy, place))]
        if found:
            scores[policy] = sum(report.alpha - report.delta_ft for report in found) / len(found)
    return max(scores, key=scores.__getitem__, default=None)


def mute_table(measured: Measured) -> str:
    """What of the best policy's results is left without messages, beside other controls; "" if nothing is known."""
    best = best_policy(measured)
    rows = []
    for shield in SHIELDS if best else ():
        for place in MUTE_MAPS:
            for measure, name in _MEASURES:
                rows += _mute_row(measured, str(best), shield, place, measure, name)
    heading = ("policy", "shield", "map (robots)", "measure", "with messages", "mute", "difference", SILENT, GREEDY)
    return markdown_table(heading, rows) if rows else ""


def _mute_row(
    measured: Measured, policy: str, shield: str, place: str, measure: str, name: str
) -> list[tuple[str, ...]]:
    talks, mute = Condition(shield), Condition(shield, mute=True)
    estimate = measured.estimate(measure, {(policy, talks): 1.0, (policy, mute): -1.0}, [place])
    if estimate is None:
        return []
    levels = ((policy, talks), (policy, mute), (SILENT, talks), (GREEDY, talks))
    values = [_value(measured.level(measure, who, place, how)) for who, how in levels]
    return [(policy, shield, place, name, *values[:2], shown(estimate, signed=True), *values[2:])]


def trainings_table(measured: Measured) -> str:
    """What the trainings of one policy differ by, with the shield idle; "" if each was trained once."""
    rows = []
    for policy in REPEATED:
        for place in FULL_MAPS:
            found = measured.trainings(policy, place, IDLE)
            if len(found) > 1:
                columns = [[getattr(report, name) for report in found] for name in ("alpha", "delta_ft")]
                each = [", ".join(f"{value:.3f}" for value in values) for values in columns]
                ranges = [f"{max(values) - min(values):.3f}" for values in columns]
                rows.append((policy, place, str(found[0].cases), *each, *ranges))
    heading = ("policy", "map (robots)", "cases", "alpha of each", "delta_FT of each", "range of alpha", "of delta_FT")
    return markdown_table(heading, rows) if rows else ""


def _value(estimate: Estimate | None) -> str:
    return "" if estimate is None else f"{estimate.value:.3f}"
