"""Policies: where they are, a folder given as such or a name in the folders of models; and what is there."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from magat_bringup import measured
from magat_robot.policy.config import ModelError
from magat_robot.policy.folder import read_folder
from magat_robot.policy.store import CONFIG, WEIGHTS, load_network

#: Bytes of a number that is sent (float32).
_FLOAT_BYTES = 4


def model_folders() -> Iterator[Path]:
    """Folders that hold policies: ``$MAGAT_MODELS``, ``models`` here, and that of the checkout this code runs from."""
    if "MAGAT_MODELS" in os.environ:
        yield Path(os.environ["MAGAT_MODELS"])
    yield Path("models")
    for parent in Path(__file__).resolve().parents:
        if (parent / "ros2_ws").is_dir():
            yield parent / "models"


def find_policy(name: str) -> Path:
    """The folder of the policy ``name``: a path, or a name such as MAGAT-F-128.

    Raises:
        ModelError: there is none.
    """
    candidates = [Path(name), *(folder / name for folder in model_folders())]
    for folder in candidates:
        if (folder / WEIGHTS).is_file():
            return folder.resolve()
    looked = ", ".join(str(folder) for folder in candidates)
    raise ModelError(f"no policy {name!r}: looked for {WEIGHTS} in {looked}")


def all_policies() -> dict[str, Path]:
    """Every policy folder, damaged ones included, in the folders of models, by its name.

    One whose name an earlier folder of models has already taken goes by its path.

    Raises:
        ModelError: there is none.
    """
    folders = dict.fromkeys(folder.resolve() for folder in model_folders())
    policies: dict[str, Path] = {}
    for models in folders:
        for folder in sorted(models.iterdir()) if models.is_dir() else ():
            if (folder / WEIGHTS).is_file() or (folder / CONFIG).is_file():
                policies[folder.name if folder.name not in policies else str(folder)] = folder
    if not policies:
        raise ModelError(f"no policies in {', '.join(map(str, folders))}: train one with `magat train`")
    return policies


def policy_of_digest(digest: str) -> Path | None:
    """The folder in the folders of models whose weights have this SHA-256; None if there is none."""
    for folder in all_policies().values():
        try:
            if read_folder(folder)[1] == digest:
                return folder
        except ModelError:
            continue  # a damaged one is not what is looked for
    return None


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
