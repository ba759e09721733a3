"""The card of a policy: what people want to know before they trust it."""

import json
from pathlib import Path

from magat_evaluation.splits import EXPERT_W, SET_SEED, SPLITS
from magat_training.train import TrainConfig, score


def card(config: TrainConfig, run: Path, hardware: str) -> str:
    """The card of a policy: how it was trained, on what, and how its validation went, in Markdown.

    Args:
        config: of the training.
        run: folder of the training, with its log.
        hardware: what it ran on.
    """
    records = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
    best = max(records, key=lambda record: score(record["alpha"], record["delta_ft"]))
    last = records[-1]
    robots = 10
    observations = last["step"] * config.batch * robots
    rows = [
        f"| {r['step']} | {r['step'] * config.batch * robots / 1e6:.1f} | {r['seconds'] / 60:.0f} "
        f"| {r['online_instants']} | {r['loss']:.4f} | {r['alpha']:.3f} | {r['delta_ft']:.3f} | {r['p_rg']:.4f} |"
        for r in records
    ]
    return f"""# {config.policy.name}

A policy of decentralised multi-robot path planning (MAGAT, RA-L 2021), trained by imitation of ECBS (w = {EXPERT_W:g})
on 20x20 cells with {robots} robots and 10 % obstacles.

- Cases: {config.train_cases} for training, {config.valid_cases} for validation (seed {SET_SEED}, numbers from 0 and
  from {SPLITS["valid"].start}).
- Training: {last["step"]} steps of {config.batch} instants, {observations / 1e6:.1f} million observations, each instant
  turned by one of the 8 symmetries of the grid; Adam, {config.first_rate:g} to {config.last_rate:g} by cosine,
  L2 {config.weight_decay:g}, seed {config.seed}.
- Online expert: {_online(config)}
- Time: {last["seconds"] / 60:.0f} minutes on {hardware}, validation not counted.
- Chosen: the checkpoint of step {best["step"]}, by alpha - delta_FT in simulated validation episodes.
- Sampling temperature, in validation and online: {config.policy.temperature:g}. Shield: idle. All measures are of the
  deployed (fixed-point) form.

Make it again: `magat train models/{config.policy.name}/training.yaml --output runs/{config.policy.name.lower()}`

## Curve

On the validation cases; online instants are those that the online expert has corrected and that are trained on.

| step | million observations | minutes | online instants | loss | alpha | delta_FT | p_rg |
|---|---|---|---|---|---|---|---|
{chr(10).join(rows)}
"""


def _online(config: TrainConfig) -> str:
    if config.online == "off":
        return "none."
    begin = (
        f"from step {config.online_from} on, every {config.online_every} steps, {config.online_cases} training cases\n"
        "  are run with the policy as it is; "
    )
    share = f"{config.online_share:.0%} of each batch"
    if config.online == "failures":
        return (
            f"{begin}each that fails is cut at its last state and solved again from there.\n  {share} comes from these."
        )
    return (
        f"{begin}every state that it comes through is solved anew.\n"
        f"  {share} comes from the last {config.online_rounds} of these rounds."
    )
