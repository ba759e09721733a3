"""The deployed form of a network: close to what was trained, exact, and refused where it cannot be."""

import copy
from collections.abc import Callable

import numpy as np
import pytest
import torch

from magat_robot.policy import fixed_point as fp
from magat_robot.policy.network import PolicyNetwork, deploy
from magat_robot.policy.policy import Decision, Policy

NAMES = ["MAGAT-F-16", "MAGAT-B-8", "MAGAT-F-8-P4", "MAGAT-B-16-P3"]


def on_grid(*shape: int, seed: int = 0) -> torch.Tensor:
    """Activations as they occur: multiples of 1/64 from 0 to 8, many at the ends."""
    generator = torch.Generator().manual_seed(seed)
    return (torch.randn(shape, generator=generator) * 200 + 200).round().clamp(0, 512) / 64


@pytest.mark.parametrize("name", NAMES)
def test_a_deployed_policy_decides_much_as_its_network_does(
    random_team: Callable, random_network: Callable, name: str
) -> None:
    network = random_network(name)
    team = random_team(np.random.default_rng(0), 30, 30)
    decision = Policy(network).decide_together(team.field_of_view, team.heard, team.streams, 0)
    with torch.no_grad():
        logits = network.eval()(torch.from_numpy(team.field_of_view).float(), torch.from_numpy(team.heard))
    trained = logits.softmax(1).numpy()
    deployed = decision.weights / decision.weights.sum(axis=1, keepdims=True)
    assert trained.std(axis=0).max() > 0.05  # robots do not all want the same
    assert np.abs(deployed - trained).mean() < 0.015
    assert np.abs(deployed - trained).max() < 0.15


def test_deploying_leaves_the_network_ready_to_go_on_training(random_network: Callable) -> None:
    network = random_network().train()
    before = copy.deepcopy(network.state_dict())
    deploy(network)
    assert network.training
    assert all(parameter.requires_grad for parameter in network.parameters())
    after = network.state_dict()
    assert list(after) == list(before)
    assert all(torch.equal(after[name], tensor) for name, tensor in before.items())


@pytest.mark.parametrize("spread", [1.0, 40.0, 1000.0], ids=lambda spread: f"weights x {spread:g}")
def test_sums_of_deployed_convolutions_are_exact_in_float32(random_network: Callable, spread: float) -> None:
    network = random_network(channels=(8, 12, 16))
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.weight.data.mul_(spread)
    extractor = deploy(network).extractor
    inputs = {extractor.stem: (on_grid(16, 3, 11, 11) > 3).float()}
    for block, (channels, side) in zip(extractor.blocks, [(8, 11), (8, 6), (12, 3)], strict=True):
        x = on_grid(16, channels, side, side)
        inputs |= {block.first: x, block.skip: x}
        inputs[block.second] = on_grid(16, block.second.conv.in_channels, 3, 3)
    for layer, x in inputs.items():
        exact = copy.deepcopy(layer).double()(x.double())
        assert torch.equal(layer(x).double(), exact)
        assert torch.equal(layer(x.contiguous(memory_format=torch.channels_last)).double(), exact)
        assert exact.abs().max() > 1e-3


@pytest.mark.parametrize("spread", [1.0, 40.0, 1000.0], ids=lambda spread: f"weights x {spread:g}")
def test_no_deployed_convolution_can_reach_two_to_the_24_units(random_network: Callable, spread: float) -> None:
    network = random_network(channels=(8, 12, 16))
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.weight.data.mul_(spread)
    extractor = deploy(network).extractor
    sums = [([extractor.stem], 0, 1.0)]
    for block in extractor.blocks:
        # The second convolution and the skip are added up: one sum.
        sums += [([block.first], 6, 8.0), ([block.second, block.skip], 6, 8.0)]
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


def test_layers_after_the_convolutions_are_exact_in_float64(random_network: Callable) -> None:
    deployed = deploy(random_network("MAGAT-B-16-P3"))
    for layer in (
        deployed.extractor.linear,
        deployed.reduction,
        deployed.graph,
        deployed.hidden,
        deployed.action,
    ):
        for parameter in layer.parameters():
            assert parameter.dtype == torch.float64
            assert torch.equal(parameter * 2**16, (parameter * 2**16).round())
            assert 0 < (parameter.abs().sum() * fp.ACTIVATION_MAX * 2 ** (16 + fp.EXPONENT_BITS)) < 2**53


def test_the_weights_of_attention_are_whole_numbers_so_that_their_sums_have_no_order(
    random_network: Callable,
) -> None:
    graph = deploy(random_network("MAGAT-F-16-P4")).graph
    x, messages = on_grid(6, 16).double(), on_grid(6, 9, 16, seed=1).double() / 4
    messages = (messages * 64).round() / 64
    weights, total = graph.attention(x, messages, torch.ones(6, 9, dtype=torch.bool))
    assert torch.equal(weights, weights.round())
    assert (weights.amax(-1) == 2**24).all()
    assert torch.equal(total, weights.sum(-1, keepdim=True))
    assert len(weights.unique()) > 20


def test_means_of_messages_halfway_between_two_steps_round_alike_in_any_order(random_network: Callable) -> None:
    network = random_network("MAGAT-F-16")
    torch.nn.init.zeros_(network.graph.query.weight)  # all weigh the same
    graph = deploy(network).graph
    # The mean of 24 multiples of 1/64 lies halfway between two multiples of 1/256 if they sum up to 3 modulo 6.
    messages = on_grid(24, 16).double() / 4
    messages = (messages * 64).round()
    messages[0] += (3 - messages.sum(0)) % 6
    x, present = torch.zeros(1, 16, dtype=torch.float64), torch.ones(1, 24, dtype=torch.bool)
    generator = torch.Generator().manual_seed(0)
    orders = [torch.randperm(24, generator=generator) for _ in range(60)]
    outputs = {graph(x, messages[order][None] / 64, present).numpy().tobytes() for order in orders}
    assert len(outputs) == 1


@pytest.mark.parametrize("name", NAMES)
def test_messages_are_on_the_grid_and_fit_into_16_bits(
    random_team: Callable, small_policy: Callable, name: str
) -> None:
    policy = small_policy(name)
    own = policy.encode(random_team(np.random.default_rng(0), 40).field_of_view)
    for values in (own.messages, own.features.numpy()):
        assert (values * 64 == np.round(values * 64)).all()
        assert values.min() >= 0
        assert 1 < values.max() <= 8
    assert own.messages.dtype == np.float32
    assert own.messages.shape == (40, policy.config.features)
    assert (own.messages.astype(np.float16) == own.messages).all()


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
        logs[temperature] = np.where(relative < -12, np.nan, relative)  # further down, table entries are small
    known = np.isfinite(logs[0.5])
    assert known.sum() > 40
    assert logs[0.5][known] == pytest.approx(2 * logs[1.0][known], abs=0.01)
    assert logs[2.0][known] == pytest.approx(logs[1.0][known] / 2, abs=0.01)


def test_an_observation_of_another_shape_is_refused(small_policy: Callable) -> None:
    with pytest.raises(ValueError, match=r"\(3, 11, 11\), not \(3, 9, 9\)"):
        small_policy().encode(np.zeros((2, 3, 9, 9), np.uint8))


def test_a_team_of_nobody_decides_nothing(small_policy: Callable) -> None:
    decision = small_policy().decide_together(
        np.zeros((0, 3, 11, 11), np.uint8), np.zeros((0, 0), np.int64), np.zeros(0, np.uint64), 0
    )
    assert decision.weights.shape == (0, 5)
    assert decision.primitives.shape == (0,)


def spoil(network: PolicyNetwork, name: str, value: float) -> PolicyNetwork:
    """``network`` with ``value`` in the first place of one of its tensors."""
    with torch.no_grad():
        network.state_dict()[name].view(-1)[0] = value
    return network


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(
    "name",
    ["extractor.stem.conv.weight", "extractor.blocks.1.skip.norm.running_mean", "graph.heard", "action.bias"],
)
def test_weights_that_are_not_finite_are_refused_by_name(random_network: Callable, name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        deploy(spoil(random_network(), name, value))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        pytest.param("extractor.stem.conv.weight", 1e8, id="a convolution"),
        pytest.param("extractor.blocks.2.second.norm.weight", 1e30, id="a normalisation"),
        pytest.param("extractor.linear.weight", 1e14, id="a layer in float64"),
        pytest.param("graph.heard", 1e14, id="the graph layer"),
    ],
)
def test_weights_too_large_for_exact_sums_are_refused(random_network: Callable, name: str, value: float) -> None:
    with pytest.raises(ValueError, match="too large"):
        deploy(spoil(random_network(), name, value))


def test_a_negative_variance_is_refused(random_network: Callable) -> None:
    with pytest.raises(ValueError, match=r"finite|NaN|variance"):
        deploy(spoil(random_network(), "extractor.stem.norm.running_var", -1.0))
