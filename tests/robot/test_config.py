"""Names of policies, and what their configurations may hold."""

import json

import pytest

from magat_robot.policy.config import ModelError, PolicyConfig


@pytest.mark.parametrize(
    ("name", "bottleneck", "features", "heads"),
    [
        ("MAGAT-F-128", False, 128, 1),
        ("MAGAT-F-16", False, 16, 1),
        ("MAGAT-B-64", True, 64, 1),
        ("MAGAT-F-32-P4", False, 32, 4),
        ("MAGAT-B-32-P4", True, 32, 4),
    ],
)
def test_the_papers_names_say_what_a_policy_is(name: str, bottleneck: bool, features: int, heads: int) -> None:
    config = PolicyConfig(name)
    assert (config.bottleneck, config.features, config.heads) == (bottleneck, features, heads)


@pytest.mark.parametrize(
    "name", ["", "MAGAT", "MAGAT-C-32", "magat-F-32", "MAGAT-F-32-P", "MAGAT-F-32-P4-x", "MAGAT-F--3"]
)
def test_other_names_are_refused_with_examples(name: str) -> None:
    with pytest.raises(ModelError, match="MAGAT-B-32-P4"):
        PolicyConfig(name)


@pytest.mark.parametrize(
    "values",
    [
        {"name": "MAGAT-F-0"},
        {"name": "MAGAT-F-8-P0"},
        {"channels": (32, 64)},
        {"channels": (32, 64, 0)},
        {"hidden": 0},
        {"temperature": 0.0},
        {"temperature": 1000.0},
        {"temperature": float("nan")},
    ],
    ids=repr,
)
def test_values_out_of_range_are_refused(values: dict) -> None:
    with pytest.raises(ModelError):
        PolicyConfig(**values)


def test_a_configuration_survives_json() -> None:
    config = PolicyConfig("MAGAT-B-32-P4", (8, 12, 16), 48, 0.5)
    assert PolicyConfig.from_json(json.loads(json.dumps(config.to_json()))) == config


@pytest.mark.parametrize(
    "change",
    [
        {"extra": 1},
        {"hidden": None},
        {"hidden": "many"},
        {"channels": 32},
        {"channels": ["a", "b", "c"]},
        {"temperature": "hot"},
        {"temperature": float("nan")},
        {"hidden": float("inf")},
    ],
    ids=repr,
)
def test_json_of_another_kind_is_refused(change: dict) -> None:
    with pytest.raises(ModelError):
        PolicyConfig.from_json(PolicyConfig().to_json() | change)


@pytest.mark.parametrize("values", [None, [], "MAGAT-F-128", {}, {"name": "MAGAT-F-128"}], ids=repr)
def test_what_is_no_configuration_is_refused(values: object) -> None:
    with pytest.raises(ModelError, match="keys"):
        PolicyConfig.from_json(values)
