"""``magat models``: the policies that are there, and what was measured of them."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from magat_evaluation import measures_file as measured
from magat_robot.policy.config import ModelError
from magat_robot.policy.store import load_network

#: Bytes of a number that is sent (float32).
_FLOAT_BYTES = 4


def describe(name: str, folder: Path) -> dict[str, Any]:
    """What the policy in ``folder`` is and what was measured of it, verified, as plain JSON values.

    Always there are ``name``, ``folder`` and ``error``: None, or why the policy, or what was measured of it, cannot be
    used. With None come ``policy`` (the paper's name), ``digest`` (SHA-256, hexadecimal), ``temperature``, ``floats``
    and ``bytes`` (what a robot sends in a step), ``weights`` (how many) and ``measures`` (reports, each with ``stale``:
    whether it is of other weights).
    """
    found = {"name": name, "folder": str(folder)}
    try:
        network, digest = load_network(folder)
        reports = measured.read(folder)
    except ModelError as error:
        return found | {"error": str(error)}
    floats = sum(network.config.message_sizes)
    return found | {
        "error": None,
        "policy": network.config.name,
        "digest": digest,
        "temperature": network.config.temperature,
        "floats": floats,
        "bytes": _FLOAT_BYTES * floats,
        "weights": sum(tensor.numel() for tensor in network.parameters()),
        "measures": [report | {"stale": measured.stale(report, digest)} for report in reports],
    }


def listing(policies: Sequence[dict[str, Any]]) -> Group:
    """``policies``, as `describe` describes them, for people."""
    result = Table(box=None, pad_edge=False)
    for heading in ("policy", "digest", "T", "floats a step", "bytes", "weights", "reports"):
        result.add_column(heading, justify="left" if heading in ("policy", "digest", "reports") else "right")
    entries, problems = [], []
    for policy in policies:
        name = escape(policy["name"])
        if policy["error"] is not None:
            result.add_row(f"[red]{name}[/]", "[red]unusable[/]")
            problems.append(Text(f"{policy['name']}: {policy['error']}", style="red"))
            continue
        fresh = sum(not report["stale"] for report in policy["measures"])
        old = len(policy["measures"]) - fresh
        result.add_row(
            name,
            policy["digest"][: measured.DIGITS],
            f"{policy['temperature']:g}",
            str(policy["floats"]),
            str(policy["bytes"]),
            f"{policy['weights']:,}",
            f"{fresh or 'none'}" + (f"[red], {old} stale[/]" if old else ""),
        )
        entries += [(policy["name"], policy["digest"], report) for report in policy["measures"]]
    parts: list[RenderableType] = [result]
    if entries:
        parts += ["", measured.table(entries)]
    if problems:
        parts += ["", *problems]
    return Group(*parts)
