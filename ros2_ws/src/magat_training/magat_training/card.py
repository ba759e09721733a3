"""The card of a policy: what people want to know before they trust it."""

import json
from pathlib import Path

from magat_training.cases import EXPERT_W, SET_SEED, SPLITS
from magat_training.train import TrainConfig, score


def card(config: TrainConfig, run: Path, threads: int) -> str:
    """The card of a policy trained in the folder ``run``: how, on what, and how its validation went, in Markdown."""
    records = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
    best = max(records, key=lambda record: score(record["alpha"], record["delta_ft"]))
    last = records[-1]
    robots = 10
    rows = [
        f"| {r['step']} | {r['step'] * config.batch * robots / 1e6:.1f} | {r['seconds'] / 60:.0f} "
        f"| {r['online_cases']} | {r['loss']:.4f} | {r['alpha']:.3f} | {r['delta_ft']:.3f} | {r['p_rg']:.4f} |"
        for r in records
    ]
    return f"""# {config.policy.name}

A policy of decentralised multi-robot path planning (MAGAT, RA-L 2021), trained by imitation of ECBS (w = {EXPERT_W:g})
on 20x20 cells with {robots} robots and 10 % obstacles.

- Cases: {config.train_cases} for training, {config.valid_cases} for validation (seed {SET_SEED}, numbers from 0 and
  from {SPLITS["valid"].start}).
- Online expert: from step {config.online_from} on, every {config.online_every} steps, {config.online_cases} training
  cases are run with the policy as it is; each that fails is cut at its last state, solved again from there and added.
  {config.online_share:.0%} of each batch comes from these ({last["online_cases"]} cases in the end).
- Training: {last["step"]} steps of {config.batch} instants, each turned by one of the 8 symmetries of the grid; Adam,
  {config.first_rate:g} to {config.last_rate:g} by cosine, L2 {config.weight_decay:g}, seed {config.seed}.
- Time: {last["seconds"] / 60:.0f} minutes with {threads} thread(s), validation not counted.
- Chosen: the checkpoint of step {best["step"]}, by alpha - 0.1 delta_FT in simulated validation episodes.
- Sampling temperature in validation: {config.policy.temperature:g}. Shield: idle. All measures are of the deployed
  (fixed-point) form.

Make it again:
`magat train --policy {config.policy.name} --threads {threads} --output runs/{config.policy.name.lower()}`

| step | million observations | minutes | online cases | loss | alpha | delta_FT | p_rg |
|---|---|---|---|---|---|---|---|
{chr(10).join(rows)}
"""
