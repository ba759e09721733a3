# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reports: what one evaluation measured, and on what."""

import dataclasses
import hashlib
import json
import types
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Union, get_args, get_origin

from magat_evaluation.cases import GENERATOR_VERSION
from magat_evaluation.outcomes import Outcomes
from magat_evaluation.sets import set_name
from magat_node.plain import plain
from magat_sim.shield import SHIELD_VERSIONS

Interval = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class EvaluationKey:
    """What ran, and on which cases: evaluations with equal keys give equal measures."""

    #: Name of the policy or baseline in tables and pictures.
    policy: str
    #: SHA-256 of the weights, hexadecimal; "" for a baseline.
    digest: str
    temperature: float
    #: Of messages; "" for a baseline.
    encoding: str
    link_loss: float
    shield: str
    #: See `SHIELD_VERSIONS`.
    shield_version: int
    #: Size of the map, cells.
    width: int
    height: int
    robots: int
    #: Share of obstacle cells.
    density: float
    #: The expert's suboptimality bound, which T_max depends on.
    expert_w: float
    #: See `GENERATOR_VERSION`.
    generator_version: int
    #: Of cases and random streams.
    seed: int
    #: Number of the first case.
    first_case: int
    #: How many cases were asked for.
    cases: int
    #: See `PolicyConfig`; 0 for a baseline.
    visit_memory: float = 0.0

    @property
    def id(self) -> str:
        """A short name of the key: 16 hexadecimal digits. It does not change when keys get a field with a default."""
        given = {field.name: getattr(self, field.name) for field in fields(EvaluationKey)}
        values = {
            field.name: given[field.name] for field in fields(EvaluationKey) if given[field.name] != field.default
        }
        return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:16]

    @property
    def place(self) -> tuple[Any, ...]:
        """What a new report has in common with the one that it replaces: what ran where, but not in which version."""
        return tuple(getattr(self, name) for name in _PLACE)

    @property
    def outdated(self) -> bool:
        """Whether it is of another version of the shield, or of other cases."""
        return (self.shield_version, self.generator_version) != (SHIELD_VERSIONS.get(self.shield), GENERATOR_VERSION)


@dataclass(frozen=True, kw_only=True)
class Report(EvaluationKey):
    """What one evaluation measured, and on what. Measures are those of `SetMeasures`, conditions those of the key."""

    #: Cases that were measured: those asked for, without those that the expert does not solve.
    cases: int
    unsolved_by_expert: int
    alpha: float
    alpha_interval: Interval
    alpha_strict: float
    alpha_strict_interval: Interval
    delta_ft: float
    delta_ft_strict: float
    #: None where a single case was measured.
    delta_ft_half_width: float | None
    p_rg: float
    #: None in reports from before it was kept.
    makespan: float | None = None
    moves_blocked: float | None = None
    #: Cases by how many robots never reached their goals; empty in reports from before it was kept.
    stranded: Mapping[int, int] = dataclasses.field(default_factory=dict)
    #: What a robot sends in a step, headers included; None in reports from before it was kept.
    bytes_per_step: int | None = None
    #: Name of the map, if the cases come from MovingAI's files.
    map: str | None = None
    #: How long the evaluation took; None if it was not kept.
    seconds: float | None = None
    #: Case by case; None if it was not kept. Neither in JSON nor among `COLUMNS`: `report_files` has a file for it.
    outcomes: Outcomes | None = None

    @property
    def key(self) -> EvaluationKey:
        """What identifies the evaluation."""
        same = {field.name: getattr(self, field.name) for field in fields(EvaluationKey)}
        return EvaluationKey(**same | {"cases": self.cases + self.unsolved_by_expert})

    @property
    def set_name(self) -> str:
        """Cells and robots, e.g. 20x20 (10)."""
        return set_name(self.width, self.height, self.robots)

    @property
    def delta_ft_error(self) -> float:
        """Half width of delta_FT's 95 % interval, for pictures and tables; 0 where there is none."""
        return self.delta_ft_half_width or 0.0

    @property
    def mute(self) -> bool:
        """Whether a policy ran without any message."""
        return self.link_loss == 1.0

    @property
    def label(self) -> str:
        """The policy's name in tables and pictures, whether it was mute, and whether it remembered its visits."""
        memory = f", visit memory {self.visit_memory:g}" if self.visit_memory else ""
        return f"{self.policy}{', mute' if self.mute else ''}{memory}"

    def stale(self, digest: str) -> bool:
        """Whether it was measured with other weights than those of ``digest``, another shield or other cases."""
        return self.digest != digest or self.outdated

    def to_json(self) -> dict[str, Any]:
        """The report as plain JSON values."""
        return plain({name: value for name, value in dataclasses.asdict(self).items() if name != "outcomes"})

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> "Report":
        """The report that `to_json` made, also when read from a JSON file; unknown keys are ignored.

        Raises:
            ValueError: a value is missing or of the wrong kind; the message names it.
        """
        given = {**values, **_REQUIRED}
        return cls(**{name: _checked(name, kind, values) for name, kind in _KINDS.items() if name in given})

    def to_row(self) -> dict[str, str]:
        """The report as cells of a CSV file, by `COLUMNS`; a cell is empty where there is no value."""
        cells: dict[str, Any] = dataclasses.asdict(self)
        for name in _INTERVALS:
            cells[f"{name}_low"], cells[f"{name}_high"] = cells.pop(f"{name}_interval")
        cells["stranded"] = " ".join(f"{robots}:{cases}" for robots, cases in self.stranded.items())
        return {name: "" if cells[name] is None else str(cells[name]) for name in COLUMNS}

    @classmethod
    def from_row(cls, row: Mapping[str, str | None]) -> "Report":
        """The report that `to_row` made.

        Raises:
            ValueError: a value is missing or of the wrong kind; the message names it.
        """
        values: dict[str, Any] = {}
        for name, kind in _KINDS.items():
            if name in _PAIRS:
                values[name] = [_number(row.get(f"{_PAIRS[name]}_{end}"), float) for end in ("low", "high")]
            elif name == "stranded":
                pairs = (entry.split(":") for entry in (row.get(name) or "").split())
                values[name] = {robots: _number(cases, int) for robots, cases in pairs}
            elif name in COLUMNS and (name in row or name in _REQUIRED):  # older files lack columns
                values[name] = row.get(name) if kind is str else _number(row.get(name), kind)
        return cls.from_json(values)


_KINDS: Mapping[str, Any] = {field.name: field.type for field in fields(Report) if field.name != "outcomes"}
_PLACE = (
    *("policy", "shield", "link_loss", "encoding", "visit_memory"),
    *("width", "height", "robots", "density", "expert_w", "seed"),
)
_REQUIRED = {
    field.name: None
    for field in fields(Report)
    if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
}
_INTERVALS = ("alpha", "alpha_strict")
_PAIRS = {f"{name}_interval": name for name in _INTERVALS}
#: Columns of CSV files, in their order: the fields of a report, an interval in two columns. `seconds` is left out, so
#: that measuring a point again gives the same file.
COLUMNS = (
    *("policy", "temperature", "encoding", "link_loss", "alpha", "alpha_low", "alpha_high"),
    *("delta_ft", "delta_ft_half_width", "p_rg", "alpha_strict", "alpha_strict_low", "alpha_strict_high"),
    *("delta_ft_strict", "cases", "unsolved_by_expert", "width", "height", "robots", "density", "expert_w", "seed"),
    *("first_case", "shield", "shield_version", "generator_version", "digest", "bytes_per_step", "makespan"),
    *("moves_blocked", "stranded", "visit_memory"),
)


def _checked(name: str, kind: Any, values: Mapping[str, Any]) -> Any:
    """The value ``name`` of a JSON object as a value of the type ``kind``."""
    value = values.get(name)
    if kind is Interval and isinstance(value, list | tuple) and len(value) == 2 and all(map(_is_number, value)):
        return tuple(value)
    if get_origin(kind) is Mapping and isinstance(value, Mapping):
        return {int(robots): cases for robots, cases in value.items()}
    kinds = get_args(kind) if get_origin(kind) in (Union, types.UnionType) else (kind,)
    if type(value) in kinds or (float in kinds and _is_number(value)):
        return value
    raise ValueError(f"{name} is {value!r}")


def _is_number(value: Any) -> bool:
    return type(value) in (int, float)


def _number(text: str | None, kind: Any) -> Any:
    """The number of the type ``kind`` in a cell; None if it is empty, the text itself if it is no number."""
    if not text:
        return None
    try:
        return int(text) if int in (kind, *get_args(kind)) else float(text)
    except ValueError:
        return text
