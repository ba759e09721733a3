# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The card of a policy: how it was trained and how well it does, for readers of its folder."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from magat_training.trainer import TrainConfig, score


def card(config: TrainConfig, run: Path, cases: Mapping[str, Any], hardware: str) -> str:
    """The card of a policy in Markdown: how it was trained, on what data, and its validation curve.

    Args:
        config: of the training.
        run: folder of the training, with its log.
        cases: ``recipe`` of the data set's manifest, see `magat_training.data`.
        hardware: what it ran on.
    """
    size, w = cases["size"], cases["expert"]["w"]
    records = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
    best = max(records, key=lambda record: score(record["alpha"], record["delta_ft"]))
    last = records[-1]
    robots = size["robots"]
    observations = last["step"] * config.batch * robots
    rows = [
        f"| {r['step']} | {r['step'] * config.batch * robots / 1e6:.1f} | {r['seconds'] / 60:.0f} "
        f"| {r['online_instants']} | {r['loss']:.4f} | {r['alpha']:.3f} | {r['delta_ft']:.3f} | {r['p_rg']:.4f} |"
        for r in records
    ]
    return f"""# {config.policy.name}

A policy of decentralised multi-robot path planning (MAGAT, RA-L 2021), trained by imitation of ECBS (w = {w:g})
on {size["width"]}x{size["height"]} cells with {robots} robots and {100 * size["density"]:g} % obstacles.

- Cases: {config.train_cases} for training, {config.valid_cases} for validation (seed {cases["seed"]}, numbers from
  {cases["splits"]["train"][0]} and from {cases["splits"]["valid"][0]}).
- Training: {last["step"]} steps of {config.batch} instants, {observations / 1e6:.1f} million observations, each instant
  turned by one of the 8 symmetries of the grid; Adam, {config.first_rate:g} to {config.last_rate:g} by cosine,
  L2 {config.weight_decay:g}, seed {config.seed}.
- Online expert: {_online(config)}
- Time: {last["seconds"] / 60:.0f} minutes on {hardware}, validation not counted.
- Chosen: the checkpoint of step {best["step"]}, the best by alpha - delta_FT in simulated validation episodes.
- Sampling temperature in validation and with the online expert: {config.policy.temperature:g}. Shield: idle. All
  measures are of the fixed-point form.

To reproduce: `magat train models/{config.policy.name}/training.yaml`

## Curve

Measures are on the validation cases. Online instants are those in use that the online expert has corrected.

| step | million observations | minutes | online instants | loss | alpha | delta_FT | p_rg |
|---|---|---|---|---|---|---|---|
{chr(10).join(rows)}
"""


def _online(config: TrainConfig) -> str:
    if config.online == "off":
        return "none."
    begin = (
        f"from step {config.online_from} on, every {config.online_every} steps, the current policy runs\n"
        f"  {config.online_cases} training cases; "
    )
    share = f"{config.online_share:.0%} of each batch"
    if config.online == "failures":
        return f"{begin}each failed episode is solved again from its last state.\n  {share} comes from these solutions."
    return (
        f"{begin}every state that it visits is solved again.\n"
        f"  {share} comes from the last {config.online_rounds} of these rounds."
    )
