# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The claims of the paper, the aims and the controls: verdicts that follow from what was measured, and from no less."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from rich.console import Console

from magat_evaluation import claims, times
from magat_evaluation.claims import Verdict, alike, difference, level, most, ordered
from magat_evaluation.measured import Condition, Measured, family
from magat_evaluation.outcomes import PARTS, Outcomes
from magat_evaluation.paper import CLAIMS, DENSER, POLICIES, SAME, claims_table, findings, panels_table, verdicts_line
from magat_evaluation.report import Report
from magat_evaluation.sets import TEST_SETS, CaseSet
from magat_evaluation.studies import figure
from magat_evaluation.summaries import aims_table, best_policy, mute_table, trainings_table
from magat_evaluation.times import Time, times_table
from magat_sim.measures import wilson

PLACES = {cases.name: cases for sets in TEST_SETS.values() for cases in sets}
LARGEST = "65x65 (100)"


def report(policy: str, place: str, failed: int, delta_ft: float = 0.04, cases: int = 200, **changes: object) -> Report:
    """Of a policy that fails in the last ``failed`` cases, in each of which one robot is stranded."""
    size = PLACES[place]
    stranded = np.arange(cases) >= cases - failed
    alpha = 1 - failed / cases
    noise = np.resize([-2, -1, 0, 1, 2], cases)
    outcomes = Outcomes(
        tuple(stranded.astype(int).tolist()),
        tuple((~stranded).astype(int).tolist()),
        tuple((round(PARTS * delta_ft) + noise).tolist()),
        (80,) * cases,
        (40,) * cases,
    )
    values = {
        "policy": policy, "digest": "ab", "temperature": 0.75, "encoding": "float32", "link_loss": 0.0,
        "shield": "idle", "shield_version": 1, "width": size.width, "height": size.height, "robots": size.robots,
        "density": 0.1, "expert_w": size.expert_w, "generator_version": 1, "seed": 1, "first_case": 26_000,
        "cases": cases, "unsolved_by_expert": 0, "alpha": alpha, "alpha_interval": wilson(cases - failed, cases),
        "alpha_strict": alpha, "alpha_strict_interval": (0.0, 1.0), "delta_ft": delta_ft, "delta_ft_strict": 0.08,
        "delta_ft_half_width": 0.001, "p_rg": 1 - failed / cases / size.robots, "makespan": 40.0,
        "outcomes": outcomes,
    }  # fmt: skip
    return Report(**values | changes)


def verdict(test: claims.Test, *reports: Report) -> Verdict:
    return test(Measured(reports)).verdict


@pytest.mark.parametrize(
    ("failed", "expected"),
    [(0, "reproduced"), (18, "not shown"), (60, "not reproduced"), (None, "not yet measured")],
)
def test_a_level_is_reached_where_the_interval_says_so(failed: int | None, expected: str) -> None:
    reports = [] if failed is None else [report("MAGAT-F-128", LARGEST, failed)]
    assert verdict(level("alpha", "MAGAT-F-128", [LARGEST], 0.91), *reports) == expected


def test_a_level_holds_on_each_map_or_not() -> None:
    test = level("delta_ft", "GNN-F-16", SAME, 0.065, at_most=True)
    good = [report("GNN-F-16", place, 0) for place in SAME]
    assert verdict(test, *good) == Verdict.REPRODUCED
    bad = report("GNN-F-16", SAME[2], 0, delta_ft=0.08)
    found = test(Measured([*good[:2], bad, *good[3:]]))
    assert (found.verdict, found.text.rpartition(", ")[2]) == (Verdict.NOT_REPRODUCED, SAME[2])
    assert verdict(test, *good[:-1]) == Verdict.NOT_MEASURED
    assert verdict(test, bad) == Verdict.NOT_REPRODUCED, "further maps cannot change it"


def test_differences_have_the_verdict_of_their_interval() -> None:
    pair = [report("a", LARGEST, 4), report("b", LARGEST, 40)]
    over = {"a": 1.0, "b": -1.0}
    assert verdict(difference("alpha", over, [LARGEST]), *pair) == Verdict.REPRODUCED
    assert verdict(difference("alpha", over, [LARGEST], 0.1), *pair) == Verdict.REPRODUCED
    assert verdict(difference("alpha", over, [LARGEST], 0.18), *pair) == Verdict.NOT_SHOWN
    assert verdict(difference("alpha", over, [LARGEST], 0.3), *pair) == Verdict.NOT_REPRODUCED
    assert verdict(difference("alpha", over, [LARGEST], lower=True), *pair) == Verdict.NOT_REPRODUCED
    assert verdict(difference("alpha", {"a": 1.0, "b": -1.47}, [LARGEST]), *pair) == Verdict.NOT_REPRODUCED
    assert verdict(difference("alpha", over, [LARGEST]), pair[0]) == Verdict.NOT_MEASURED
    faster = [report("a", LARGEST, 0, delta_ft=0.03), report("b", LARGEST, 0, delta_ft=0.05)]
    assert verdict(difference("delta_ft", over, [LARGEST], lower=True), *faster) == Verdict.REPRODUCED
    assert verdict(alike("alpha", "a", "b", [LARGEST]), *pair) == Verdict.NOT_REPRODUCED
    assert verdict(alike("alpha", "a", "b", [LARGEST]), *faster) == Verdict.REPRODUCED


def test_maps_of_a_set_count_alike_case_by_case() -> None:
    reports = [report("a", place, 0) for place in SAME] + [report("b", place, 0) for place in SAME]
    reports[0] = report("a", SAME[0], 0, cases=1000)
    reports[-1] = report("b", SAME[-1], 140)
    found = Measured(reports).estimate("alpha", {("a", Condition()): 1.0, ("b", Condition()): -1.0}, SAME)
    assert found is not None
    assert (found.value, found.cases) == (pytest.approx(0.1), 1400), "the cases that both have"


def test_an_order_needs_every_step() -> None:
    names = ["a", "b", "c"]
    test = ordered("alpha", names, [LARGEST])
    falling = [report(name, LARGEST, failed) for name, failed in zip(names, (2, 40, 90), strict=True)]
    assert verdict(test, *falling) == Verdict.REPRODUCED
    assert verdict(test, falling[0], report("b", LARGEST, 4), falling[2]) == Verdict.NOT_SHOWN
    assert verdict(test, report("a", LARGEST, 80), *falling[1:]) == Verdict.NOT_REPRODUCED
    assert verdict(test, *falling[:2]) == Verdict.NOT_MEASURED


def test_most_is_more_than_half_of_all() -> None:
    test = most([level("alpha", name, [LARGEST], 0.92) for name in "abc"])
    good, bad = (lambda name: report(name, LARGEST, 0)), (lambda name: report(name, LARGEST, 100))
    assert verdict(test) == verdict(test, good("a")) == Verdict.NOT_MEASURED
    assert verdict(test, good("a"), good("b")) == Verdict.REPRODUCED
    assert verdict(test, bad("a"), bad("b"), good("c")) == Verdict.NOT_REPRODUCED
    assert verdict(test, report("a", LARGEST, 16), report("b", LARGEST, 16), good("c")) == Verdict.NOT_SHOWN


def test_trainings_of_a_policy_are_one_policy() -> None:
    assert [family(name) for name in ("GNN-F-128-S2", "MAGAT-F-128-K1", "MAGAT-F-32-P4")] == [
        "GNN-F-128", "MAGAT-F-128-K1", "MAGAT-F-32-P4",
    ]  # fmt: skip
    one = [report("GNN-F-128", LARGEST, 10), report("GNN-F-16", LARGEST, 30)]
    more = [report("GNN-F-128-S1", LARGEST, 50), report("GNN-F-128-S2", LARGEST, 5)]
    test = ordered("alpha", ["GNN-F-128", "GNN-F-16"], [LARGEST])
    assert verdict(test, *one) == Verdict.REPRODUCED
    assert verdict(test, *one, *more) == Verdict.NOT_SHOWN, "another training may be worse"
    assert trainings_table(Measured(one)) == ""
    row = trainings_table(Measured([*one, *more])).splitlines()[2]
    assert row == "| GNN-F-128 | 65x65 (100) | 200 | 0.950, 0.750, 0.975 | 0.040, 0.040, 0.040 | 0.225 | 0.000 |"


def test_every_claim_has_a_verdict_on_nothing_and_on_everything() -> None:
    nothing = findings(Measured([]))
    assert {found.verdict for _, found in nothing} == {Verdict.NOT_MEASURED, Verdict.NOT_COMPARABLE}
    names = (*POLICIES, "HCA", "Replan")
    everything = findings(Measured([report(name, place, 6, cases=50) for name in names for place in PLACES]))
    assert Verdict.NOT_MEASURED not in {found.verdict for _, found in everything}
    lines = claims_table(everything).splitlines()
    assert len(lines) == len(CLAIMS) + 2
    assert len({line.count("|") for line in lines}) == 1
    assert len(panels_table(everything).splitlines()) == 8 + 2
    assert verdicts_line(nothing) == f"{len(CLAIMS)} claims: 1 not comparable, {len(CLAIMS) - 1} not yet measured"


def test_each_panel_of_the_papers_figure_has_claims() -> None:
    assert set("abcdefgh") == {letter for claim in CLAIMS for letter in claim.panels}
    assert len({claim.text for claim in CLAIMS}) == len(CLAIMS)


@pytest.mark.parametrize(
    ("failed", "cell"),
    [(0, "reached: 1.000 (0.996 to 1.000)"), (13, "not shown: 0.987"), (40, "missed: 0.960")],
)
def test_an_aim_is_reached_where_the_interval_says_so(failed: int, cell: str) -> None:
    reports = [report("GNN-F-64", place, 0, cases=1000) for place in {*SAME, *DENSER}]
    reports.append(report("GNN-F-64", "50x50 (30)", failed, cases=1000))
    row = aims_table(Measured(reports)).splitlines()[2]
    assert row.startswith(f"| GNN-F-64 | {cell}")
    assert row.endswith("|  |"), "200x200 (1000) was not measured"
    assert aims_table(Measured([])) == ""


def rows(text: str) -> Sequence[Sequence[str]]:
    return [line.strip("| ").split(" | ") for line in text.splitlines()[2:]]


def test_what_is_left_when_mute_stands_beside_the_control() -> None:
    talks = [report(name, "20x20 (10)", failed) for name, failed in (("GNN-F-16", 4), ("MAGAT-F-16", 40))]
    mute = report("GNN-F-16", "20x20 (10)", 64, link_loss=1.0)
    greedy = report("greedy", "20x20 (10)", 120, digest="")
    measured = Measured([*talks, mute, greedy])
    assert best_policy(measured) == "GNN-F-16"
    alpha, delta_ft, last = rows(mute_table(measured))
    assert alpha[:6] == ["GNN-F-16", "idle", "20x20 (10)", "alpha", "0.980", "0.680"]
    assert alpha[6].startswith("+0.300 (+0.2")
    assert (alpha[7:], delta_ft[3], last[3]) == (["", "0.400"], "delta_FT, first", "delta_FT, last")
    assert mute_table(Measured(talks)) == mute_table(Measured([])) == ""


def test_reports_without_outcomes_are_shown_but_not_compared() -> None:
    old = [dataclasses.replace(report(name, LARGEST, 0), outcomes=None) for name in "ab"]
    assert verdict(level("alpha", "a", [LARGEST], 0.9), *old) == Verdict.REPRODUCED
    assert verdict(difference("alpha", {"a": 1.0, "b": -1.0}, [LARGEST]), *old) == Verdict.NOT_MEASURED


def test_the_figure_is_drawn_of_what_there_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    some = [report(name, place, 6, cases=50) for name in ("GNN-F-64", "MAGAT-B-16", "greedy") for place in SAME[:3]]
    drawn: list[str] = []
    monkeypatch.setattr(figure, "_line", lambda axes, measured, policy, *_: drawn.append(policy))
    figure.draw_figure(Measured([]), tmp_path / "none.png")
    assert {*drawn} >= {*POLICIES, "HCA", "Replan", "greedy"}
    monkeypatch.undo()
    axes = Figure().add_subplot()
    for policy in ("GNN-F-64", "MAGAT-B-16", "HCA"):
        figure._line(axes, Measured(some), policy, SAME, "alpha")
    solid, dashed = (line for container in axes.containers for line in container.lines[:1])
    assert (solid.get_color(), solid.get_linestyle(), len(solid.get_xdata())) == ("tab:blue", "-", 3)
    assert (dashed.get_color(), dashed.get_linestyle(), len(dashed.get_xdata())) == ("tab:purple", "--", 3)


def test_times_are_for_each_successful_case() -> None:
    slow = Time("200x200 (1000)", "MAGAT-B-32-P4", "ab", 4, 3, policy_seconds=39.0, expert_seconds=5.6)
    fast = dataclasses.replace(slow, map="200x200 (500)", expert_seconds=60.0)
    never = dataclasses.replace(slow, map="100x100 (500)", successes=0)
    found = rows(times_table([slow, fast, never]))
    assert found[0][2:] == ["1286.8", "33,000 to 35,000", "3 of 4", "13.0", "1.4", "9.3", "not reproduced"]
    assert found[1][-2:] == ["0.9", "reproduced"]
    assert found[2][-1] == "not reproduced"
    assert times_table([]) == ""


def test_times_are_measured_until_all_maps_are_there(
    policies: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(TEST_SETS, "large", [CaseSet.square(8, 3, 1), CaseSet.square(9, 3, 1)])
    named = {times.PAPER_POLICY: policies["first"]}
    times.update_times(named, tmp_path, Console(quiet=True))
    found = times.read_times(tmp_path / times.TIMES)
    assert [(one.map, one.cases) for one in found] == [("8x8 (3)", 1), ("9x9 (3)", 1)]
    assert all(one.policy_seconds >= 0 and one.digest for one in found)
    asked: list[Path] = []
    monkeypatch.setattr(times, "measure_times", lambda folder, *_: asked.append(folder))
    times.update_times(named, tmp_path, Console(quiet=True))
    times.update_times({"second": policies["second"]}, tmp_path, Console(quiet=True))
    assert not asked
    lines = (tmp_path / times.TIMES).read_text().splitlines()
    (tmp_path / times.TIMES).write_text("\n".join(lines[:-1]) + "\n")
    times.update_times(named, tmp_path, Console(quiet=True))
    assert asked == [policies["first"]]
