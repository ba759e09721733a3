# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The fixed-point form of a network: close to the trained form, exact, and refused if it cannot be exact."""

import copy
from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest
import torch

from magat_robot.policy import fixed_point as fp
from magat_robot.policy.extractor import ConvNorm, FeatureExtractor, WholeConvNorm
from magat_robot.policy.graph import GraphLayer
from magat_robot.policy.interface import Decision
from magat_robot.policy.network import PolicyNetwork, to_fixed_point
from magat_robot.policy.policy import Policy


def on_grid(*shape: int, seed: int = 0) -> torch.Tensor:
    """Realistic activations: multiples of 1/64 from 0 to 8, many at both ends."""
    generator = torch.Generator().manual_seed(seed)
    return (torch.randn(shape, generator=generator) * 200 + 200).round().clamp(0, 512) / 64


def test_a_deployed_policy_decides_much_as_its_network_does(
    random_team: Callable, random_network: Callable, variant: dict
) -> None:
    network = random_network(**variant)
    team = random_team(np.random.default_rng(0), 30, 30)
    decision = Policy(network).decide_together(team.field_of_view, team.heard, team.streams, 0)
    with torch.no_grad():
        logits = network.eval()(torch.from_numpy(team.field_of_view).float(), torch.from_numpy(team.heard))
    trained = logits.softmax(1).numpy()
    deployed = decision.weights / decision.weights.sum(axis=1, keepdims=True)
    assert trained.std(axis=0).max() > 0.05  # the robots' decisions differ
    assert np.abs(deployed - trained).mean() < 0.01
    assert np.abs(deployed - trained).max() < 0.15


def test_deploying_leaves_the_network_ready_to_go_on_training(random_network: Callable, variant: dict) -> None:
    network = random_network(**variant).train()
    before = copy.deepcopy(network.state_dict())
    to_fixed_point(network)
    assert network.training
    assert all(parameter.requires_grad for parameter in network.parameters())
    after = network.state_dict()
    assert list(after) == list(before)
    assert not any("folded" in name for name in after)
    assert all(torch.equal(after[name], tensor) for name, tensor in before.items())
    assert {tensor.dtype for name, tensor in after.items() if "num_batches" not in name} == {torch.float32}


@pytest.fixture(params=[1.0, 40.0, 800.0], ids=lambda spread: f"weights x {spread:g}")
def spread(request: pytest.FixtureRequest) -> float:
    return request.param


@pytest.fixture(params=[("MAGAT-F-16", "padded"), ("MAGAT-F-16", "centred"), ("GNN_baseline-F-16", "padded")], ids=str)
def extractor(request: pytest.FixtureRequest, random_network: Callable, spread: float) -> FeatureExtractor:
    """The fixed-point CNN of a network whose normalisations are scaled by ``spread``."""
    network = random_network(request.param[0], cnn=request.param[1], channels=(8, 12, 16))
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.weight.data.mul_(spread)
    return to_fixed_point(network).extractor


def test_sums_of_deployed_convolutions_are_exact_in_float32(extractor: FeatureExtractor) -> None:
    for layer in extractor.modules():
        if isinstance(layer, ConvNorm):
            side = layer.conv.kernel_size[0] if isinstance(layer, WholeConvNorm) else 6
            x = on_grid(16, layer.conv.in_channels, side, side)
            if layer.conv.in_channels == 3:  # the first one has inputs 0 and 1
                x = (x > 3).float()
            exact = copy.deepcopy(layer).double()(x.double())
            assert torch.equal(layer(x).double(), exact)
            assert torch.equal(layer(x.contiguous(memory_format=torch.channels_last)).double(), exact)
            assert exact.abs().max() > 1e-3


def test_no_deployed_convolution_can_reach_two_to_the_24_units(extractor: FeatureExtractor) -> None:
    zeros_and_ones, activations = (0, 1.0), (6, 8.0)
    if extractor.stem is not None:
        sums = [([extractor.stem], *zeros_and_ones)]
        for block in extractor.blocks:
            # The second convolution and the skip feed one sum.
            sums += [([block.first], *activations), ([block.second, block.skip], *activations)]
    else:
        layers = [layer for block in extractor.blocks for layer in (block.first, block.second) if layer is not None]
        sums = [([layer], *(activations if i else zeros_and_ones)) for i, layer in enumerate(layers)]
    assert sum(len(layers) for layers, *_ in sums) in (10, 5)
    for layers, input_bits, input_max in sums:
        for channel in range(layers[0].conv.out_channels):
            weights = torch.cat([layer.conv.weight[channel].double().flatten() for layer in layers])
            biases = torch.stack([layer.conv.bias[channel].double() for layer in layers])
            bits = whole_bits(torch.cat([weights, biases * 2.0**input_bits]))
            most = (weights.abs().sum() * input_max + biases.abs().sum()) * 2.0 ** (bits + input_bits)
            assert most < 2**24


def whole_bits(values: torch.Tensor) -> int:
    """The smallest k from 0 to 14 for which ``values`` are multiples of ``2**-k``."""
    for k in range(15):
        if (values * 2**k == (values * 2**k).round()).all():
            return k
    raise AssertionError("values that are on no grid")


def test_layers_after_the_convolutions_are_exact_in_float64(random_network: Callable, variant: dict) -> None:
    deployed = to_fixed_point(random_network(**variant))
    checked = 0
    for layer in (deployed.extractor.linear, deployed.reduction, *deployed.layers, deployed.hidden, deployed.action):
        for name, parameter in layer.named_parameters():
            checked += 1
            assert parameter.dtype == torch.float64
            assert torch.equal(parameter * 2**16, (parameter * 2**16).round())
            # Only sums over neighbours can exceed the range of activations.
            most = fp.SUM_MAX if name == "taps" else fp.ACTIVATION_MAX
            assert parameter.abs().sum() * most * 2 ** (16 + fp.EXPONENT_BITS) < 2**53
            assert parameter.any() or not parameter.numel()
    convolutions = [module for module in deployed.modules() if isinstance(module, torch.nn.Conv2d)]
    in_float32 = sum(len(list(convolution.parameters())) for convolution in convolutions)
    assert checked == len(list(deployed.parameters())) - in_float32


@pytest.mark.parametrize("name", ["MAGAT-F-16-P4", "GAT-F-16-P4"])
def test_the_weights_of_attention_are_whole_numbers_so_that_their_sums_have_no_order(
    random_network: Callable, name: str
) -> None:
    layer = to_fixed_point(random_network(name)).layers[0]
    x, messages = on_grid(6, 16).double(), on_grid(6, 9, 16, seed=1).double() / 4
    messages = (messages * 64).round() / 64
    weights, total = layer.attention(x, messages, torch.ones(6, 9, dtype=torch.bool))
    assert torch.equal(weights, weights.round())
    assert (weights.amax(-1) == 2**24).all()
    assert torch.equal(total, weights.sum(-1, keepdim=True))
    assert len(weights.unique()) > 20


@pytest.mark.parametrize("large", [False, True], ids=["as trained", "as large as may be"])
@pytest.mark.parametrize("name", ["MAGAT-F-8-P3", "GAT-F-8-P3"])
def test_scores_of_attention_are_exact_sums(random_network: Callable, name: str, large: bool) -> None:
    layer = to_fixed_point(random_network(name)).layers[0]
    weights = layer.query.weight if name.startswith("MAGAT") else layer.folded
    if large:
        weights.copy_(fp.snap_float64(weights * (0.999 * 2**16 / weights.abs().sum()), name))
    x, keys = on_grid(4, 8).double(), on_grid(4, 3, 8, seed=1).double()
    scores, queries = layer.scores(x, keys), []
    for r, p, m in np.ndindex(4, 3, 3):
        own, key = ([Fraction(value) for value in values.tolist()] for values in (x[r], keys[r, m]))
        if name.startswith("MAGAT"):
            rows = weights[p * 8 : p * 8 + 8].tolist()
            query = [sum(Fraction(w) * value for w, value in zip(row, own, strict=True)) for row in rows]
            # Rounded to the nearest multiple of 1/64, half to even, up to 64.
            query = [min(max(Fraction(round(64 * value), 64), Fraction(-64)), Fraction(64)) for value in query]
            queries += query
            exact = sum(q * value for q, value in zip(query, key, strict=True))
        else:
            receiver, sender = weights[0, p].tolist(), weights[1, p].tolist()
            exact = sum(
                Fraction(a) * mine + Fraction(b) * theirs
                for a, mine, b, theirs in zip(receiver, own, sender, key, strict=True)
            )
        assert Fraction(float(scores[r, p, m])) == exact
    assert not queries or large == (64 in queries)


def test_logits_are_multiples_of_a_256th_and_no_larger_than_64(random_network: Callable, variant: dict) -> None:
    network = random_network(**variant)
    field_of_view = (torch.rand(20, 3, 11, 11, generator=torch.Generator().manual_seed(5)) < 0.2).float()
    heard = (torch.arange(20)[:, None] + torch.arange(1, 4)) % 20
    logits = to_fixed_point(network)(field_of_view, heard)
    with torch.no_grad():
        network.action.weight.mul_(200)
    larger = to_fixed_point(network)(field_of_view, heard)
    for values in (logits, larger):
        assert torch.equal(values * 256, (values * 256).round())
    assert 0.5 < logits.abs().max() < 20
    assert larger.max() == -larger.min() == 64


def test_attention_folded_into_two_vectors_does_not_show_in_which_order_they_were_added_up(
    random_network: Callable,
) -> None:
    network = random_network("GAT-F-128-P4")
    turned = copy.deepcopy(network)
    with torch.no_grad():
        # The same sums with the terms in reverse order.
        turned.layers[0].taps.copy_(network.layers[0].taps.flip(3))
        turned.layers[0].pair.copy_(network.layers[0].pair.flip(2))
    assert torch.equal(to_fixed_point(network).layers[0].folded, to_fixed_point(turned).layers[0].folded)


@pytest.mark.parametrize("hop", [1, 2])
@pytest.mark.parametrize("name", ["MAGAT-F-16", "GAT-F-16", "GNN-F-16"])
def test_means_of_messages_halfway_between_two_steps_round_alike_in_any_order(
    random_network: Callable, name: str, hop: int
) -> None:
    network = random_network(name, taps=3)
    for parameter in ("query.weight", "pair"):
        if parameter in dict(network.layers[0].named_parameters()):
            torch.nn.init.zeros_(network.layers[0].get_parameter(parameter))  # equal attention
    layer = to_fixed_point(network).layers[0]
    # The mean of 24 multiples of 1/256 lies halfway between two multiples if their sum is 12 modulo 24.
    unit = 4 if hop == 1 else 1
    values = (on_grid(24, 16).double() / 4 * 256 / unit).round() * unit
    values[0] += (12 - values.sum(0)) % 24
    x, present = torch.zeros(1, 16, dtype=torch.float64), torch.ones(1, 24, dtype=torch.bool)
    messages = layer.message(torch.zeros(24, 16), values[:, None] / 256) if hop == 2 else values / 256
    generator = torch.Generator().manual_seed(0)
    orders = [torch.randperm(24, generator=generator) for _ in range(60)]
    outputs = {layer.receive(x, messages[order][None], present).numpy().tobytes() for order in orders}
    assert len(outputs) == 1
    expected = (values.sum(0) / 24).round() / 256
    assert torch.equal(layer.receive(x, messages[None], present)[0, 0], expected)


@pytest.fixture
def summing(random_network: Callable) -> GraphLayer:
    """A fixed-point layer with the bare adjacency and weights close to their limit."""
    network = random_network("GNN-F-8-P3", taps=3, normalise=False)
    with torch.no_grad():
        for parameter in network.layers[0].parameters():
            parameter.mul_(0.999 * 2**16 / parameter.abs().sum())
    return to_fixed_point(network).layers[0]


@pytest.mark.parametrize("neighbours", [2, 150, 1000])
def test_sums_over_many_neighbours_are_exact_up_to_where_they_are_cut_off(summing: GraphLayer, neighbours: int) -> None:
    present = torch.ones(2, neighbours, dtype=torch.bool)
    first = on_grid(2, neighbours, 8).double()
    # In the second hop each message can be as large as a sum of the first hop, in multiples of 1/256.
    second = (torch.rand(2, neighbours, 8, generator=torch.Generator().manual_seed(4)).double() * 2**19).round() / 256
    second[1] /= neighbours
    second[1] = (second[1] * 256).round() / 256
    cut = []
    for messages in (first, second):
        aggregated = summing.receive(torch.zeros(2, 8).double(), messages, present)
        exact = [[sum(map(Fraction, column)) for column in zip(*robot, strict=True)] for robot in messages.tolist()]
        expected = [[float(min(value, Fraction(2048))) for value in row] for row in exact]
        assert aggregated[:, 0].tolist() == expected
        cut += [value == 2048 for row in expected for value in row]
    assert any(cut)
    assert not all(cut)


def test_what_large_sums_are_multiplied_by_leaves_them_exact(summing: GraphLayer) -> None:
    sums = 2048 - on_grid(5, 1, 8).double() / 4  # 2048 and slightly less, in multiples of 1/256
    assert torch.equal(sums * 256, (sums * 256).round())
    x = 8 - on_grid(5, 8).double() / 64
    x = (x * 64).round() / 64
    total = summing.own(x) + summing.tap(1, sums) + summing.tap(2, sums)
    A_0, (A_1, A_2) = summing.own.weight.tolist(), summing.taps.tolist()
    for r in range(5):
        for p in range(3):
            for g in range(8):
                exact = sum(
                    Fraction(A_0[p * 8 + g][f]) * Fraction(float(x[r, f]))
                    + (Fraction(A_1[p][f][g]) + Fraction(A_2[p][f][g])) * Fraction(float(sums[r, 0, f]))
                    for f in range(8)
                )
                assert Fraction(float(total[r, p * 8 + g])) == exact
    # In float32 these sums are not exact.
    assert not torch.equal(total, total.float().double())
    assert total.abs().max() > 1e6


def test_messages_of_every_round_are_on_their_grid(
    random_team: Callable, small_policy: Callable, variant: dict
) -> None:
    policy = small_policy(**variant)
    team = random_team(np.random.default_rng(0), 40)
    own = policy.perceive(team.field_of_view)
    config = policy.config
    for values in (own.state.features.numpy(), own.state.x.numpy()):
        assert (values * 64 == np.round(values * 64)).all()
        assert values.min() >= 0
        assert 1 < values.max() <= 8
    for number, size in enumerate(config.message_sizes):
        messages = own.messages
        assert messages.dtype == np.float32
        assert messages.shape == (40, size)
        if size:
            first = number % (config.taps - 1) == 0
            units = messages.astype(np.float64) * (64 if first else 256)
            assert (units == np.round(units)).all()
            assert messages.min() >= 0
            assert 1 < messages.max() <= (8 if first or config.normalise else 2048)
            # Means are exact in float16, too.
            assert not (first or config.normalise) or (messages.astype(np.float16) == messages).all()
        own = policy.hear(own, messages[np.maximum(team.heard, 0)], team.heard >= 0)
    assert own.messages.shape == (40, 0)  # no messages after the last round
    assert (own.state.x * 64 == (own.state.x * 64).round()).all()
    assert 1 < own.state.x.max() <= 8


def test_weights_of_decisions_are_whole_and_log_probabilities_their_logarithms(
    random_team: Callable, small_policy: Callable
) -> None:
    team = random_team(np.random.default_rng(0), 30)
    decision = small_policy().decide_together(team.field_of_view, team.heard, team.streams, 0)
    assert decision.weights.shape == (30, 5)
    assert (decision.weights == decision.weights.round()).all()
    assert (decision.weights.max(axis=1) == 2**24).all()
    share = decision.weights / decision.weights.sum(axis=1, keepdims=True)
    assert np.exp(decision.log_probabilities) == pytest.approx(share, rel=1e-5)
    assert decision.log_probabilities.dtype == np.float32


def test_a_probability_that_rounds_to_zero_has_a_finite_logarithm() -> None:
    decision = Decision(np.array([[2.0**24, 0, 1, 0, 0]]), np.array([0]))
    logs = decision.log_probabilities[0]
    assert np.isfinite(logs).all()
    assert logs[1] == logs[3] < logs[2] < logs[0]
    assert logs[2] - logs[1] == pytest.approx(np.log(2), abs=1e-5)


def test_the_temperature_divides_the_logits(random_team: Callable, random_network: Callable) -> None:
    team = random_team(np.random.default_rng(0), 20)
    logs = {}
    for temperature in (0.5, 1.0, 2.0):
        policy = Policy(random_network(temperature=temperature))
        decision = policy.decide_together(team.field_of_view, team.heard, team.streams, 0)
        relative = np.log(np.maximum(decision.weights, 0.5) / 2**24)
        logs[temperature] = np.where(relative < -12, np.nan, relative)  # below, the table's rounding dominates
    known = np.isfinite(logs[0.5])
    assert known.sum() > 40
    assert logs[0.5][known] == pytest.approx(2 * logs[1.0][known], abs=0.01)
    assert logs[2.0][known] == pytest.approx(logs[1.0][known] / 2, abs=0.01)


def test_an_observation_of_another_shape_is_refused(small_policy: Callable) -> None:
    with pytest.raises(ValueError, match=r"\(3, 11, 11\), not \(3, 9, 9\)"):
        small_policy().perceive(np.zeros((2, 3, 9, 9), np.uint8))


def test_a_team_of_nobody_decides_nothing(small_policy: Callable) -> None:
    decision = small_policy().decide_together(
        np.zeros((0, 3, 11, 11), np.uint8), np.zeros((0, 0), np.int64), np.zeros(0, np.uint64), 0
    )
    assert decision.weights.shape == (0, 5)
    assert decision.primitives.shape == (0,)


def spoil(network: PolicyNetwork, name: str, value: float) -> PolicyNetwork:
    """``network`` with ``value`` as the first element of one of its tensors."""
    with torch.no_grad():
        network.state_dict()[name].view(-1)[0] = value
    return network


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(
    ("policy", "name"),
    [
        ("MAGAT-F-16", "extractor.stem.conv.weight"),
        ("MAGAT-F-16", "extractor.blocks.1.skip.norm.running_mean"),
        ("GNN_baseline-F-16", "extractor.blocks.0.first.norm.running_mean"),
        ("MAGAT-F-16", "layers.0.query.weight"),
        ("GAT-F-16", "layers.0.pair"),
        ("GNN-F-16", "layers.0.taps"),
        ("MAGAT-F-16", "action.bias"),
    ],
)
def test_weights_that_are_not_finite_are_refused_by_name(
    random_network: Callable, policy: str, name: str, value: float
) -> None:
    with pytest.raises(ValueError, match=name):
        to_fixed_point(spoil(random_network(policy), name, value))


@pytest.mark.parametrize(
    ("policy", "name", "value"),
    [
        pytest.param("MAGAT-F-16", "extractor.stem.conv.weight", 1e8, id="a convolution"),
        pytest.param("GNN_baseline-F-16", "extractor.blocks.1.second.conv.weight", 1e8, id="a plain convolution"),
        pytest.param("MAGAT-F-16", "extractor.blocks.2.second.norm.weight", 1e30, id="a normalisation"),
        pytest.param("MAGAT-F-16", "extractor.linear.weight", 1e14, id="a layer in float64"),
        pytest.param("MAGAT-F-16", "layers.0.query.weight", 7e4, id="MAGAT's W"),
        pytest.param("GAT-F-16", "layers.0.pair", 7e4, id="GAT's H"),
        pytest.param("GNN-F-16", "layers.0.taps", 7e4, id="A_1"),
        pytest.param("GNN-F-16", "layers.0.own.weight", -7e4, id="A_0"),
    ],
)
def test_weights_too_large_for_exact_sums_are_refused(
    random_network: Callable, policy: str, name: str, value: float
) -> None:
    with pytest.raises(ValueError, match="too large"):
        to_fixed_point(spoil(random_network(policy), name, value))


def test_a_product_of_weights_too_large_for_exact_sums_is_refused(random_network: Callable) -> None:
    network = random_network("GAT-F-16")
    with torch.no_grad():
        for parameter in (network.layers[0].taps, network.layers[0].pair):
            parameter.mul_(5000 / parameter.abs().sum())  # each alone is within the bound
        network.layers[0].taps[0, 0, 0, 0] = network.layers[0].pair[0, 0, 0] = 5000
    with pytest.raises(ValueError, match=r"layers\.0\.folded .*too large"):
        to_fixed_point(network)


def test_a_negative_variance_is_refused(random_network: Callable) -> None:
    with pytest.raises(ValueError, match=r"finite|NaN|variance"):
        to_fixed_point(spoil(random_network(), "extractor.stem.norm.running_var", -1.0))
