# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every claim of the paper on its results, and what was measured here of it."""

from collections import Counter
from collections.abc import Sequence

from magat_evaluation.claims import Claim, Finding, Verdict, alike, difference, incomparable, level, most, ordered
from magat_evaluation.measured import Measured
from magat_evaluation.sets import TEST_SETS
from magat_evaluation.tables import markdown_table


def _maps(name: str, least: int = 0, most_robots: int = 10**9) -> tuple[str, ...]:
    """The maps of one of `TEST_SETS` with the given numbers of robots."""
    return tuple(cases.name for cases in TEST_SETS[name] if least <= cases.robots <= most_robots)


SAME, DENSER, LARGE = _maps("same-density"), _maps("increasing-density"), _maps("large")
_SIXTY = _maps("increasing-density", most_robots=60)
_LARGEST, _CROWDED, _THOUSAND, _HUNDRED = (("65x65 (100)",), ("50x50 (100)",), ("200x200 (1000)",), ("100x100 (500)",))
_SIZES = (128, 64, 32, 16)
#: The paper's policies.
GNN = tuple(f"GNN-{kind}-{size}" for kind in "FB" for size in _SIZES)
MAGAT = (*(f"MAGAT-{kind}-{size}" for kind in "FB" for size in _SIZES), "MAGAT-F-32-P4", "MAGAT-B-32-P4")
POLICIES = (*MAGAT, *GNN, "GAT-F-128", "GNN_baseline-F-128")
#: alpha on 65x65 (100) in the paper's text.
_ALPHA = {
    "MAGAT-F-128": 0.91, "MAGAT-F-64": 0.85, "MAGAT-F-32": 0.81, "MAGAT-F-16": 0.78,
    "GNN-F-128": 0.83, "GNN-F-64": 0.78, "GNN-F-32": 0.82, "GNN-F-16": 0.77,
}  # fmt: skip
_SETS = (("same-density", SAME, "c", "d"), ("increasing-density", DENSER, "g", "h"))


def _over(one: str, other: str) -> dict[str, float]:
    return {one: 1.0, other: -1.0}


def _better(source: str, one: str, other: str) -> list[Claim]:
    """A MAGAT policy has a higher alpha and a lower delta_FT than another one, on both sets."""
    return [
        claim
        for name, maps, alpha, delta_ft in _SETS
        for claim in (
            Claim(source, f"{one} has a higher alpha than {other}, {name}",
                  difference("alpha", _over(one, other), maps), alpha),
            Claim(source, f"{one} has a lower delta_FT than {other}, {name}",
                  difference("delta_ft", _over(one, other), maps, lower=True), delta_ft),
        )
    ]  # fmt: skip


_BASELINES = "VI-E, comparison with baselines"
_BANDWIDTH = "VI-E, effect of reducing the information"
_DENSITIES = "VI-E, robot densities"
_BOTTLENECK = "VI-E, effect of the bottleneck"
_HEADS = "VI-E, multi-head attention"
_SCALE = "VI-E, super-large scale"
_SUMMARY = "VI-E, summary"
_OWN = "Replan here is our own implementation"

CLAIMS: tuple[Claim, ...] = (
    Claim(_BASELINES, "GNN-F-128 is slightly better than GNN_baseline-F-128 on maps below 40x40, same-density",
          difference("alpha", _over("GNN-F-128", "GNN_baseline-F-128"), _maps("same-density", 0, 30)), "a"),
    Claim(_BASELINES, "GNN-F-128 is more than 5 points of alpha above GNN_baseline-F-128 beyond 40x40, same-density",
          difference("alpha", _over("GNN-F-128", "GNN_baseline-F-128"), _maps("same-density", 41), 0.05), "a"),
    Claim(_BASELINES, "GNN-F-128 is better than GNN_baseline-F-128, increasing-density",
          difference("alpha", _over("GNN-F-128", "GNN_baseline-F-128"), DENSER), "e"),
    *_better(_BASELINES, "MAGAT-F-128", "GAT-F-128"),
    Claim(_BASELINES, "GAT-F-128 is close to MAGAT-F-16 only",
          alike("alpha", "GAT-F-128", "MAGAT-F-16", SAME), "c"),
    Claim(_BASELINES, "HCA finds no solution for 100 robots", level("alpha", "HCA", _CROWDED, 0.05, at_most=True), "eg",
          "HCA here is our own implementation; it tries up to 20 orders of the robots"),
    *(claim for name, maps, alpha, delta_ft in (("same-density", SAME, "ac", "bd"),
                                                ("increasing-density", DENSER, "eg", "fh")) for claim in (
        Claim(_BASELINES, f"Replan has a lower alpha than the learned policies (here MAGAT-F-128), {name}",
              difference("alpha", _over("MAGAT-F-128", "Replan"), maps), alpha, _OWN),
        Claim(_BASELINES, f"Replan has a higher delta_FT than the learned policies (here MAGAT-F-128), {name}",
              difference("delta_ft", _over("MAGAT-F-128", "Replan"), maps, lower=True), delta_ft, _OWN))),
    *(Claim(_BANDWIDTH, f"{policy} has alpha {alpha:.2f} on 65x65 (100)",
            level("alpha", policy, _LARGEST, alpha), "c" if policy.startswith("MAGAT") else "a", "tested as: at least")
      for policy, alpha in _ALPHA.items()),
    Claim(_BANDWIDTH, "alpha of MAGAT falls from 128 over 64 and 32 to 16 features, 65x65 (100)",
          ordered("alpha", [f"MAGAT-F-{size}" for size in _SIZES], _LARGEST), "c"),
    Claim(_BANDWIDTH, "alpha of GNN falls from 128 to 16 features, 65x65 (100)",
          ordered("alpha", ["GNN-F-128", "GNN-F-16"], _LARGEST), "a",
          "with 32 features the paper's own number is higher than with 64"),
    Claim(_BANDWIDTH, "alpha of MAGAT falls less than that of GNN, 65x65 (100)",
          difference("alpha", _over("GNN-F-128", "GNN-F-16") | {"MAGAT-F-128": -1.0, "MAGAT-F-16": 1.0}, _LARGEST),
          "ac", "the paper's own numbers say the opposite: 13 points against 6"),
    *(Claim(_DENSITIES, f"most MAGAT policies have {text}, 50x50, 10 to 60 robots",
            most([level(measure, policy, _SIXTY, bound, at_most) for policy in MAGAT]), panel)
      for text, measure, bound, at_most, panel in (
          ("alpha above 0.92", "alpha", 0.92, False, "g"), ("delta_FT below 0.10", "delta_ft", 0.10, True, "h"))),
    Claim(_BOTTLENECK, "GNN-B-64 has a higher alpha than GNN-F-64, by around 8 points, 65x65 (100)",
          difference("alpha", _over("GNN-B-64", "GNN-F-64"), _LARGEST), "a", "tested as: higher"),
    Claim(_BOTTLENECK, "GNN policies do not benefit significantly from the bottleneck, 65x65 (100), 16 features",
          alike("alpha", "GNN-B-16", "GNN-F-16", _LARGEST), "a"),
    Claim(_BOTTLENECK, "MAGAT-F-16 falls far below MAGAT-F-128 (12 points), 65x65 (100)",
          difference("alpha", _over("MAGAT-F-128", "MAGAT-F-16"), _LARGEST, 0.05), "c", "tested as: 5 points or more"),
    *(Claim(_BOTTLENECK, f"with the bottleneck MAGAT is comparable with MAGAT-F-128: MAGAT-B-{size}, 65x65 (100)",
            alike("alpha", f"MAGAT-B-{size}", "MAGAT-F-128", _LARGEST), "c") for size in _SIZES[1:]),
    Claim(_BOTTLENECK, "the bottleneck helps MAGAT: MAGAT-B-16 over MAGAT-F-16, 65x65 (100)",
          difference("alpha", _over("MAGAT-B-16", "MAGAT-F-16"), _LARGEST), "c"),
    *(claim for kind in "FB" for claim in _better(_HEADS, f"MAGAT-{kind}-32-P4", f"MAGAT-{kind}-32")),
    *(claim for policy in ("MAGAT-F-32-P4", "MAGAT-B-32-P4") for claim in (
        Claim(_HEADS, f"{policy} has alpha 0.95 on 50x50 (100)", level("alpha", policy, _CROWDED, 0.95), "g",
              "tested as: at least"),
        Claim(_HEADS, f"{policy} has delta_FT below 0.065, same-density",
              level("delta_ft", policy, SAME, 0.065, at_most=True), "d"))),
    Claim(_SCALE, "MAGAT-B-32-P4 has alpha above 0.80 on 200x200 (1000)",
          level("alpha", "MAGAT-B-32-P4", _THOUSAND, 0.80)),
    Claim("abstract; VI-E, summary", "MAGAT-B-32-P4 is 47 % over the benchmark on 200x200 (1000)",
          difference("alpha", {"MAGAT-B-32-P4": 1.0, "GNN_baseline-F-128": -1.47}, _THOUSAND), "",
          "the paper does not say which benchmark; tested as: 1.47 times GNN_baseline-F-128"),
    Claim(_SCALE, "all policies have p_rg of at least 0.986, large",
          most([level("p_rg", policy, LARGE, 0.986) for policy in POLICIES]), "", "tested as: most of them"),
    *(Claim(_SCALE, f"{policy} has p_rg of at least 0.996 on 100x100 (500)",
            level("p_rg", policy, _HUNDRED, 0.996)) for policy in ("MAGAT-F-128", "MAGAT-F-32-P4", "MAGAT-B-32-P4")),
    Claim(_SCALE, "GNN-F-128 has a lower p_rg (0.986) than MAGAT-F-128 on 100x100 (500)",
          difference("p_rg", _over("MAGAT-F-128", "GNN-F-128"), _HUNDRED)),
    Claim(_SUMMARY, "attention helps: MAGAT-F-128 has a higher alpha than GNN-F-128 (91 against 83), 65x65 (100)",
          difference("alpha", _over("MAGAT-F-128", "GNN-F-128"), _LARGEST), "ac"),
    *(Claim(_SUMMARY, f"where alpha is similar, MAGAT has a lower delta_FT than GNN: {size} features, same-density",
            difference("delta_ft", _over(f"MAGAT-F-{size}", f"GNN-F-{size}"), SAME, lower=True), "bd")
      for size in (128, 16)),
    Claim("IV", "MAGAT does not depend on the order of robots, nor on the time",
          incomparable("proven, not measured; here a test compares bits. The shield pibt-memory depends on the past")),
)  # fmt: skip

#: The panels of the paper's figure of results, which has no numbers: what they show, in their order.
PANELS = {
    letter: f"{measure} of {layer} and baselines, {name}"
    for letter, (name, layer, measure) in zip(
        "abcdefgh",
        [
            (name, layer, measure)
            for name in ("same-density", "increasing-density")
            for layer in ("GNN", "MAGAT")
            for measure in ("alpha", "delta_FT")
        ],
        strict=True,
    )
}


Findings = Sequence[tuple[Claim, Finding]]


def findings(measured: Measured) -> Findings:
    """Every claim of the paper, with what was measured of it."""
    return [(claim, claim.test(measured)) for claim in CLAIMS]


def claims_table(found: Findings) -> str:
    """Every claim with its verdict, in Markdown."""
    rows = []
    for claim, finding in found:
        here = "; ".join(part for part in (finding.text, claim.remark) if part)
        rows.append((claim.source, claim.text, here, str(finding.verdict)))
    return markdown_table(("source", "the paper", "here", "verdict"), rows)


def panels_table(found: Findings) -> str:
    """The panels of the paper's figure with the verdicts on the claims that they support, in Markdown."""
    rows = []
    for letter, title in PANELS.items():
        count = Counter(finding.verdict for claim, finding in found if letter in claim.panels)
        rows.append((letter, title, ", ".join(f"{count[one]} {one}" for one in Verdict if count[one])))
    return markdown_table(("panel", "it shows", "claims of the text that it supports"), rows)


def verdicts_line(found: Findings) -> str:
    """How many claims have which verdict."""
    count = Counter(finding.verdict for _, finding in found)
    return f"{len(found)} claims: " + ", ".join(f"{count[one]} {one}" for one in Verdict if count[one])
