"""The card that goes with a policy."""

from dataclasses import replace
from pathlib import Path

from magat_robot.policy.config import PolicyConfig
from magat_training.card import card
from magat_training.cases import SolvedCase
from magat_training.train import TrainConfig, Trainer


def test_the_card_tells_how_the_policy_was_trained_and_which_checkpoint_was_chosen(
    tmp_path: Path, solved: list[SolvedCase]
) -> None:
    config = TrainConfig(
        PolicyConfig("MAGAT-B-16", channels=(4, 4, 8), hidden=16), steps=9, batch=8, validate_every=3, seed=77
    )
    trainer = Trainer(config, tmp_path, solved[:6], solved[6:])
    reached = {}
    trainer.run(lambda step, _: reached.update({step: trainer.best}))
    text = card(config, tmp_path, threads=2)
    assert text.startswith("# MAGAT-B-16\n")
    assert "seed 77" in text
    assert [line.split("|")[1].strip() for line in text.splitlines() if line.startswith("| ")][1:] == ["3", "6", "9"]
    # `best` is seen before the validation of the same step.
    chosen = 3 if trainer.best == reached[6] else 6 if trainer.best == reached[9] else 9
    assert f"checkpoint of step {chosen}," in text
    assert f"checkpoint of step {chosen}," in card(replace(config, seed=78), tmp_path, threads=2)
