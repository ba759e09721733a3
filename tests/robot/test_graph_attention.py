"""The graph layer and its place in the network, against Eq. 5 to 8 of the paper, number by number."""

import math
from collections.abc import Callable

import numpy as np
import pytest
import torch

from magat_robot.policy.network import GraphAttention

CAP = 8.0  # sigma is a ReLU that ends here, so that activations fit the grid of the deployed policy
SLOPE = 0.2


def leaky_relu(value: float) -> float:
    return value if value > 0 else SLOPE * value


def sigma(value: float) -> float:
    return min(max(value, 0.0), CAP)


def attention_by_hand(W: np.ndarray, x: np.ndarray, messages: np.ndarray) -> list[float]:
    """Eq. 6 and 7 for one receiver and one head: e_ij for each of the messages j."""
    size = len(x)
    scores = []
    for message in messages:
        score = sum(x[a] * W[a, b] * message[b] for a in range(size) for b in range(size))
        scores.append(math.exp(leaky_relu(score)))
    return [score / sum(scores) for score in scores]


def layer_by_hand(layer: GraphAttention, x: np.ndarray, messages: np.ndarray) -> list[float]:
    """Eq. 5 with K = 2 and Eq. 8 for one receiver."""
    size = len(x)
    out: list[float] = []
    for p in range(layer.heads):
        W, A_0, A_1 = matrices(layer, p)
        e = attention_by_hand(W, x, messages)
        for g in range(size):
            own = sum(x[f] * A_0[f, g] for f in range(size))
            fused = sum(
                e_j * message[f] * A_1[f, g] for e_j, message in zip(e, messages, strict=True) for f in range(size)
            )
            out.append(sigma(own + fused))
    return out


def matrices(layer: GraphAttention, p: int) -> list[np.ndarray]:
    """W, A_0 and A_1 of head p, each to be multiplied from the right, as in the paper."""
    size = layer.heard.shape[1]
    rows = slice(p * size, (p + 1) * size)
    tensors = (layer.query.weight[rows].T, layer.own.weight[rows].T, layer.heard[p])
    return [tensor.detach().double().numpy() for tensor in tensors]


@pytest.fixture(params=[1, 4], ids=["P=1", "P=4"])
def layer(request: pytest.FixtureRequest, random_network: Callable) -> GraphAttention:
    suffix = {1: "", 4: "-P4"}[request.param]
    return random_network(f"MAGAT-F-6{suffix}", seed=request.param).graph.double()


def spread(layer: GraphAttention, receivers: int = 7, places: int = 5) -> tuple[torch.Tensor, ...]:
    """Features so large that some outputs are cut off at either end, and some places without a message."""
    generator = torch.Generator().manual_seed(1)
    size = layer.heard.shape[1]
    x = 8 * torch.rand(receivers, size, generator=generator, dtype=torch.float64)
    messages = 8 * torch.rand(receivers, places, size, generator=generator, dtype=torch.float64)
    present = torch.rand(receivers, places, generator=generator) < 0.7
    present[0] = False
    present[1] = True
    return x, messages, present


def test_attention_is_the_softmax_over_what_the_receiver_hears(layer: GraphAttention) -> None:
    x, messages, present = spread(layer)
    weights, total = layer.attention(x, messages, present)
    e = (weights / total).detach().numpy()
    assert e.shape == (7, layer.heads, 5)
    for i in range(7):
        for p in range(layer.heads):
            heard = messages[i, present[i]].numpy()
            expected = attention_by_hand(matrices(layer, p)[0], x[i].numpy(), heard)
            assert e[i, p, present[i].numpy()] == pytest.approx(expected, abs=1e-12)
            assert not e[i, p, ~present[i].numpy()].any()
    assert e[1].std(axis=1).min() > 0.01  # it prefers some


def test_the_layer_is_that_of_the_paper(layer: GraphAttention) -> None:
    x, messages, present = spread(layer)
    y = layer(x, messages, present).detach().numpy()
    assert y.shape == (7, layer.heads * 6)
    for i in range(7):
        expected = layer_by_hand(layer, x[i].numpy(), messages[i, present[i]].numpy())
        assert y[i] == pytest.approx(expected, abs=1e-12)
    assert {0.0, CAP} < set(y.ravel().tolist())


def test_without_neighbours_only_the_own_term_is_left(layer: GraphAttention) -> None:
    x, _, _ = spread(layer)
    nobody = torch.zeros(7, 0, 6, dtype=torch.float64)
    y = layer(x, nobody, torch.zeros(7, 0, dtype=torch.bool)).detach().numpy()
    for i in range(7):
        assert y[i] == pytest.approx(layer_by_hand(layer, x[i].numpy(), np.zeros((0, 6))), abs=1e-12)


def test_heads_are_independent_and_stand_one_after_the_other(random_network: Callable) -> None:
    layer = random_network("MAGAT-F-6-P4").graph.double()
    x, messages, present = spread(layer)
    before = layer(x, messages, present)
    with torch.no_grad():
        layer.query.weight[12:18] *= -3  # of head 2
    changed = (layer(x, messages, present) != before).any(dim=0).unflatten(0, (4, 6)).any(dim=1)
    assert changed.tolist() == [False, False, True, False]


@pytest.mark.parametrize("name", ["MAGAT-F-6", "MAGAT-F-6-P4", "MAGAT-B-6", "MAGAT-B-6-P4"])
def test_the_network_fuses_a_team_as_in_the_paper(random_team: Callable, random_network: Callable, name: str) -> None:
    network = random_network(name, seed=3).double()
    team = random_team(np.random.default_rng(3), 9)
    view, heard = torch.from_numpy(team.field_of_view).double(), torch.from_numpy(team.heard)
    features, x = network.encode(view)
    S = np.array([[j in row for j in range(9)] for row in team.heard.tolist()], dtype=float)
    assert S.any()
    assert (S == S.T).all()
    assert not S.diagonal().any()

    heads = []
    X = x.detach().numpy()
    for p in range(network.config.heads):
        W, A_0, A_1 = matrices(network.graph, p)
        E = np.zeros((9, 9))
        for i in range(9):
            neighbours = np.flatnonzero(S[i])
            E[i, neighbours] = attention_by_hand(W, X[i], X[neighbours])
        heads.append(np.clip(X @ A_0 + (E * S) @ X @ A_1, 0, CAP))
    parts = [*([features.detach().numpy()] if "-B-" in name else []), *heads]
    fused = torch.from_numpy(np.concatenate(parts, axis=1))
    expected = network.action(network.hidden(fused).clamp(0, CAP))
    assert network(view, heard).detach().numpy() == pytest.approx(expected.detach().numpy(), abs=1e-10)


def test_only_the_bottleneck_carries_the_robots_own_features_past_the_exchange(
    random_network: Callable,
) -> None:
    for name, width, reaches in (("MAGAT-F-6-P4", 24, False), ("MAGAT-B-6-P4", 24 + 128, True)):
        network = random_network(name)
        assert network.hidden.in_features == width
        x, messages, present = torch.rand(3, 6), torch.rand(3, 2, 6), torch.ones(3, 2, dtype=torch.bool)
        plain = network.fuse(torch.zeros(3, 128), x, messages, present)
        other = network.fuse(torch.ones(3, 128), x, messages, present)
        assert bool((plain != other).any()) is reaches


def test_encoding_gives_128_features_and_num_features_to_send(random_network: Callable) -> None:
    features, x = random_network("MAGAT-B-32").encode((torch.rand(4, 3, 11, 11) < 0.2).float())
    assert features.shape == (4, 128)
    assert x.shape == (4, 32)


def test_the_extractor_is_a_stem_and_three_residual_blocks(random_network: Callable) -> None:
    network = random_network(channels=(4, 6, 10)).double()
    view = (torch.rand(5, 3, 11, 11, generator=torch.Generator().manual_seed(2)) < 0.2).double()
    x = network.extractor.stem(view).clamp(0, CAP)
    shapes = [tuple(x.shape[1:])]
    for block in network.extractor.blocks:
        inner = block.first(x).clamp(0, CAP)
        x = (block.second(inner) + block.skip(x)).clamp(0, CAP)
        shapes.append(tuple(x.shape[1:]))
    assert shapes == [(4, 11, 11), (4, 6, 6), (6, 3, 3), (10, 3, 3)]
    expected = network.extractor.linear(x.flatten(1)).clamp(0, CAP)
    assert torch.equal(network.extractor(view), expected)
