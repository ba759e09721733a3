# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The table of policies: at which temperatures they sample, and how they were trained."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from magat_evaluation.tables import markdown_table
from magat_robot.policy.config import ModelError
from magat_robot.policy.folder import count_weights, read_folder, read_temperature
from magat_sim.shield import SHIELDS

#: The recipe in a policy's folder.
RECIPE = "training.yaml"
_TRAINED = ("steps", "batch", "online", "seed")


def policies_table(policies: Mapping[str, Path]) -> str:
    """The policies that can be used, in Markdown; cells are empty where the folder has no recipe.

    Args:
        policies: folder of each, by its name.
    """
    heading = ("policy", "taps", "weights", *(f"T, {shield}" for shield in SHIELDS), "steps", "instants a step",
               "states that the online expert corrects", "seed")  # fmt: skip
    rows = []
    for name, folder in policies.items():
        try:
            config, _, _ = read_folder(folder)
            temperatures = [f"{read_temperature(folder, shield):g}" for shield in SHIELDS]
            weights = f"{count_weights(folder):,}"
        except ModelError:
            continue  # `magat models` says why
        recipe = _recipe(folder)
        rows.append((name, str(config.taps), weights, *temperatures, *(str(recipe.get(one, "")) for one in _TRAINED)))
    return markdown_table(heading, rows) if rows else ""


def _recipe(folder: Path) -> Mapping[str, Any]:
    file = folder / RECIPE
    values = yaml.safe_load(file.read_text()) if file.is_file() else None
    return values if isinstance(values, dict) else {}
