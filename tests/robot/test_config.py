# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Policy names, and the values that configurations may hold."""

import json

import pytest

from magat_robot.policy.config import ModelError, PolicyConfig


@pytest.mark.parametrize(
    ("name", "layer", "bottleneck", "features", "heads"),
    [
        ("MAGAT-F-128", "MAGAT", False, 128, 1),
        ("MAGAT-F-16", "MAGAT", False, 16, 1),
        ("MAGAT-B-64", "MAGAT", True, 64, 1),
        ("MAGAT-F-32-P4", "MAGAT", False, 32, 4),
        ("MAGAT-B-32-P4", "MAGAT", True, 32, 4),
        ("GNN-F-64", "GNN", False, 64, 1),
        ("GNN-B-64", "GNN", True, 64, 1),
        ("GAT-F-128", "GAT", False, 128, 1),
        ("GAT-B-32-P4", "GAT", True, 32, 4),
        ("GNN_baseline-F-128", "GNN_baseline", False, 128, 1),
        ("GNN_baseline-B-16-P12", "GNN_baseline", True, 16, 12),
    ],
)
def test_the_papers_names_say_what_a_policy_is(
    name: str, layer: str, bottleneck: bool, features: int, heads: int
) -> None:
    config = PolicyConfig(name)
    assert (config.layer.name, config.bottleneck) == (layer, bottleneck)
    assert (config.features, config.heads) == (features, heads)


@pytest.mark.parametrize(
    "name",
    [
        "",
        "MAGAT",
        "MAGAT-C-32",
        "magat-F-32",
        "MAGAT-F-32-P",
        "MAGAT-F-32-P4-x",
        "MAGAT-F--3",
        "MAGAT-F-32\n",
        "MAGAT-F-٣٢",
        "MAGAT_baseline-F-32",
        "GAT_baseline-F-32",
        "GNN-baseline-F-32",
        "GNN_baseline",
        "GNN_Baseline-F-32",
        "gnn-F-32",
        "GCN-F-32",
        "GAT-X",
        "AGAT-F-32",
        "MAGAT-F-" + 5000 * "9",
    ],
    ids=lambda name: repr(name[:30]),
)
def test_other_names_are_refused_with_examples(name: str) -> None:
    with pytest.raises(ModelError, match="MAGAT-B-32-P4"):
        PolicyConfig(name)


@pytest.mark.parametrize(
    ("name", "taps", "layers", "sizes"),
    [
        ("MAGAT-F-128", 2, 1, (128,)),
        ("MAGAT-B-32-P4", 2, 1, (32,)),
        # From the second hop on: x, and the aggregate of each head. The x of the next layer has all heads.
        ("MAGAT-F-32-P4", 3, 1, (32, 32 + 4 * 32)),
        ("MAGAT-F-8-P3", 4, 2, (8, 8 + 24, 8 + 24, 24, 24 + 72, 24 + 72)),
        ("GAT-B-16", 3, 2, (16, 32, 16, 32)),
        ("GAT-F-16-P2", 2, 3, (16, 32, 32)),
        # Without attention x is not repeated, and all heads share one aggregate.
        ("GNN-F-64", 2, 1, (64,)),
        ("GNN-F-64-P4", 3, 2, (64, 64, 256, 256)),
        ("GNN_baseline-F-128", 3, 1, (128, 128)),
        # Robots that send nothing.
        ("MAGAT-F-128", 1, 1, (0,)),
        ("GAT-F-16-P4", 1, 3, (0,)),
        ("GNN-F-16", 1, 2, (0,)),
    ],
)
def test_each_round_of_each_layer_has_its_size_of_messages(
    name: str, taps: int, layers: int, sizes: tuple[int, ...]
) -> None:
    assert PolicyConfig(name, taps=taps, layers=layers).message_sizes == sizes


@pytest.mark.parametrize(
    "values",
    [
        {"name": "MAGAT-F-0"},
        {"name": "MAGAT-F-8-P0"},
        {"name": "MAGAT-F-4097"},
        {"name": "MAGAT-F-128-P33"},
        {"channels": (32, 64)},
        {"channels": (32, 64, 0)},
        {"channels": (32, 4097, 64)},
        {"cnn": ""},
        {"cnn": "wide"},
        {"hidden": 0},
        {"hidden": 4097},
        {"taps": 0},
        {"taps": -1},
        {"taps": 18},
        {"taps": 10**12},
        {"layers": 0},
        {"layers": -3},
        {"layers": 17},
        {"layers": 17, "taps": 1},
        {"layers": 10**12},
        {"layers": 6, "taps": 4},
        # 129 * 32 numbers in the second round.
        {"name": "MAGAT-F-32-P128", "taps": 3},
        {"temperature": 0.0},
        {"temperature": 1000.0},
        {"temperature": float("nan")},
        {"encoding": ""},
        {"encoding": "float64"},
        {"encoding": "INT8"},
    ],
    ids=repr,
)
def test_values_out_of_range_are_refused(values: dict) -> None:
    with pytest.raises(
        ModelError, match=r"three channels|at most 16|the limit is 4096|temperature|float32, float16, int8|unknown CNN"
    ):
        PolicyConfig(**values)


@pytest.mark.parametrize(
    "values",
    [
        {"name": "MAGAT-F-4096"},
        {"name": "MAGAT-F-32-P128"},
        {"name": "GNN-F-32-P128", "taps": 3},
        {"taps": 17},
        {"layers": 16},
        {"layers": 16, "taps": 1},
        {"layers": 4, "taps": 5},
        {"temperature": 0.01},
        {"temperature": 100.0},
        {"encoding": "float16"},
        {"encoding": "int8"},
    ],
    ids=repr,
)
def test_values_at_the_ends_of_their_ranges_are_allowed(values: dict) -> None:
    config = PolicyConfig(**values)
    assert len(config.message_sizes) <= 16


def test_a_configuration_survives_json() -> None:
    sizes = {"cnn": "centred", "hidden": 48, "taps": 3, "layers": 2, "normalise": False}
    config = PolicyConfig("GNN-B-32-P4", (8, 12, 16), **sizes, encoding="int8", temperature=0.5)
    values = config.to_json()
    assert PolicyConfig.from_json(values) == PolicyConfig.from_json(json.loads(json.dumps(values))) == config
    assert json.loads(json.dumps(values)) == values  # plain values: no tuples


@pytest.mark.parametrize(
    ("name", "sizes", "largest"),
    [
        ("MAGAT-F-8", {"taps": 3, "layers": 2}, 8),
        ("GAT-F-8", {"normalise": False, "taps": 3}, 8),
        ("GNN-F-8", {"taps": 3}, 8),
        # Messages of the first round are no sums.
        ("GNN-F-8", {"normalise": False}, 8),
        ("GNN-F-8", {"normalise": False, "taps": 3}, 2048),
        ("GNN_baseline-F-8", {"normalise": False, "taps": 3}, 2048),
    ],
)
def test_only_bare_sums_over_neighbours_make_messages_of_large_numbers(name: str, sizes: dict, largest: float) -> None:
    assert PolicyConfig(name, **sizes).largest == largest


def test_a_whole_number_may_be_a_temperature() -> None:
    assert PolicyConfig.from_json(PolicyConfig().to_json() | {"temperature": 2}) == PolicyConfig(temperature=2.0)


@pytest.mark.parametrize(
    "change",
    [
        {"extra": 1},
        {"name": 128},
        {"name": None},
        {"name": ["MAGAT-F-128"]},
        {"hidden": None},
        {"hidden": "many"},
        {"hidden": 128.0},
        {"hidden": True},
        {"hidden": float("inf")},
        {"channels": 32},
        {"channels": (32, 64, 128)},
        {"channels": "abc"},
        {"channels": ["a", "b", "c"]},
        {"channels": [32, 64, True]},
        {"channels": {"0": 32, "1": 64, "2": 128}},
        {"cnn": None},
        {"cnn": 1},
        {"cnn": ["padded"]},
        {"taps": "two"},
        {"taps": 2.0},
        {"taps": True},
        {"taps": None},
        {"taps": [2]},
        {"layers": 1.5},
        {"layers": "1"},
        {"layers": True},
        {"normalise": 1},
        {"normalise": 0},
        {"normalise": "true"},
        {"normalise": None},
        {"encoding": None},
        {"encoding": 1},
        {"encoding": ["int8"]},
        {"temperature": "hot"},
        {"temperature": True},
        {"temperature": None},
    ],
    ids=repr,
)
def test_json_of_another_kind_is_refused(change: dict) -> None:
    with pytest.raises(ModelError, match=r"unusable policy configuration|exactly the keys"):
        PolicyConfig.from_json(PolicyConfig().to_json() | change)


@pytest.mark.parametrize(
    "change",
    [{"temperature": float("nan")}, {"temperature": 10**400}, {"hidden": 10**400}, {"taps": 10**400}],
    ids=lambda change: repr(change)[:30],
)
def test_numbers_out_of_range_are_refused_in_json_too(change: dict) -> None:
    with pytest.raises(ModelError, match=r"within|at most"):
        PolicyConfig.from_json(PolicyConfig().to_json() | change)


@pytest.mark.parametrize(
    "key", ["name", "channels", "hidden", "taps", "layers", "normalise", "encoding", "temperature"]
)
def test_a_missing_key_is_refused(key: str) -> None:
    values = PolicyConfig().to_json()
    del values[key]
    with pytest.raises(ModelError, match="exactly the keys"):
        PolicyConfig.from_json(values)


def test_a_configuration_without_a_cnn_has_the_padded_one() -> None:
    values = PolicyConfig().to_json()
    del values["cnn"]
    assert PolicyConfig.from_json(values).cnn == "padded"


@pytest.mark.parametrize("values", [None, [], "MAGAT-F-128", {}, {"name": "MAGAT-F-128"}], ids=repr)
def test_what_is_no_configuration_is_refused(values: object) -> None:
    with pytest.raises(ModelError, match="keys"):
        PolicyConfig.from_json(values)
