# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The graph layers and the network against a plain Python computation of Eq. 3 and 5 to 9 of the paper.

Matrices are lists of rows here, and what is done with them is written out, so that nothing is shared with the layers.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch

from magat_robot.policy.graph import GraphAttention, GraphConvolution, GraphLayer, MessageAwareAttention
from magat_robot.policy.network import NodeState, PolicyNetwork

Matrix = list[list[float]]

CAP = 8.0  # sigma is a ReLU capped at this value, so that activations have a bounded range in fixed point
SLOPE = 0.2

KINDS = ["MAGAT", "GAT", "GNN", "GNN, bare"]


def sigma(value: float) -> float:
    return min(max(value, 0.0), CAP)


def leaky_relu(value: float) -> float:
    return value if value > 0 else SLOPE * value


def product(A: Matrix, B: Matrix) -> Matrix:
    return [[sum(a * B[k][c] for k, a in enumerate(row)) for c in range(len(B[0]))] for row in A]


def linear(X: Matrix, layer: torch.nn.Linear) -> Matrix:
    weight, bias = layer.weight.tolist(), layer.bias.tolist()
    return [[sum(w * v for w, v in zip(weight[o], row, strict=True)) + bias[o] for o in range(len(bias))] for row in X]


class Head:
    """The matrices of one head, multiplied from the right as in the paper."""

    def __init__(self, layer: GraphLayer, p: int) -> None:
        inputs, outputs = layer.inputs, len(layer.own.weight) // layer.heads
        own = layer.own.weight.tolist()
        self.A = [[[own[p * outputs + g][f] for g in range(outputs)] for f in range(inputs)]]
        self.A += [taps[p] for taps in layer.taps.tolist()]
        self.divided = isinstance(layer, GraphConvolution) and layer.normalise
        self.W = self.H = None
        if isinstance(layer, MessageAwareAttention):
            query = layer.query.weight.tolist()
            self.W = [[query[p * inputs + b][a] for b in range(inputs)] for a in range(inputs)]
        elif isinstance(layer, GraphAttention):
            receiver, sender = layer.pair.tolist()
            self.H = receiver[p] + sender[p]

    def score(self, x_i: list[float], x_j: list[float]) -> float:
        """e_ij: Eq. 7 or Eq. 9."""
        if self.W is not None:
            return sum(x_i[a] * w * x_j[b] for a, row in enumerate(self.W) for b, w in enumerate(row))
        assert self.H is not None
        joined = product([x_i], self.A[1])[0] + product([x_j], self.A[1])[0]
        return sum(y * h for y, h in zip(joined, self.H, strict=True))

    def attention(self, x_i: list[float], neighbours: Matrix) -> list[float]:
        """Row i of E where S is not 0: Eq. 6 (and all ones in Eq. 3)."""
        if self.W is None and self.H is None:
            return [1.0 for _ in neighbours]
        exponentials = [math.exp(leaky_relu(self.score(x_i, x_j))) for x_j in neighbours]
        return [value / sum(exponentials) for value in exponentials]

    def weights(self, x_i: list[float], neighbours: Matrix) -> list[float]:
        """Row i of E * S where S is not 0."""
        s = 1 / len(neighbours) if self.divided and neighbours else 1.0
        return [e * s for e in self.attention(x_i, neighbours)]

    def shift(self, X: Matrix, heard: list[list[int]]) -> Matrix:
        """E * S, N x N."""
        ES = [[0.0] * len(X) for _ in X]
        for i, row in enumerate(heard):
            for j, weight in zip(row, self.weights(X[i], [X[j] for j in row]), strict=True):
                ES[i][j] = weight
        return ES


def powers(ES: Matrix, X: Matrix, hops: int) -> list[Matrix]:
    """``(E * S)^k X`` for k from 0 to ``hops``."""
    result, power = [X], [[float(i == j) for j in range(len(X))] for i in range(len(X))]
    for _ in range(hops):
        power = product(power, ES)
        result.append(product(power, X))
    return result


def layer_by_hand(layer: GraphLayer, X: Matrix, heard: list[list[int]]) -> Matrix:
    """Eq. 5 (or 3) and 8 for a whole team."""
    Y: Matrix = [[] for _ in X]
    for p in range(layer.heads):
        head = Head(layer, p)
        shifted = powers(head.shift(X, heard), X, len(head.A) - 1) if len(head.A) > 1 else [X]
        terms = [product(X_k, A_k) for X_k, A_k in zip(shifted, head.A, strict=True)]
        for i, row in enumerate(Y):
            row += [sigma(sum(values)) for values in zip(*(term[i] for term in terms), strict=True)]
    return Y


def network_by_hand(network: PolicyNetwork, features: Matrix, heard: list[list[int]]) -> Matrix:
    """Logits of a team, from the 128 features of each robot."""
    X = [[sigma(value) for value in row] for row in linear(features, network.reduction)]
    for layer in network.layers:
        X = layer_by_hand(layer, X, heard)
    if network.config.bottleneck:
        X = [own + fused for own, fused in zip(features, X, strict=True)]
    return linear([[sigma(value) for value in row] for row in linear(X, network.hidden)], network.action)


@pytest.fixture(scope="module")
def made(random_network: Callable) -> Callable:
    """Makes small networks, in float64."""

    def make(kind: str, type_and_size: str, **sizes: object) -> PolicyNetwork:
        layer, _, bare = kind.partition(", ")
        sizes = {"channels": (2, 3, 4), "hidden": 6, "normalise": not bare} | sizes
        return random_network(f"{layer}-{type_and_size}", **sizes).double()

    return make


def team(robots: int, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor, list[list[int]]]:
    """Fields of view, and which robots hear which: asymmetric, one robot without neighbours, shuffled, with gaps."""
    rng = np.random.default_rng(seed)
    field_of_view = torch.from_numpy((rng.random((robots, 3, 11, 11)) < 0.2).astype(np.float64))
    S = rng.random((robots, robots)) < 0.45
    np.fill_diagonal(S, False)
    S[1], S[2] = False, True
    S[2, 2] = False
    assert (S != S.T).any()
    assert len(set(S.sum(axis=1).tolist())) > 3
    rows = np.where(S, np.arange(robots), -1)
    heard = torch.from_numpy(np.stack([rng.permutation(row) for row in rows]))
    return field_of_view, heard, [[j for j in row if j >= 0] for row in heard.tolist()]


@pytest.mark.parametrize(
    ("type_and_size", "taps", "layers"),
    [("F-5", 2, 1), ("B-3-P4", 2, 2), ("F-3-P4", 3, 1), ("B-4", 3, 2), ("F-3-P4", 1, 2)],
    ids=lambda value: str(value),
)
@pytest.mark.parametrize("kind", [*KINDS, "GNN_baseline"])
def test_a_team_decides_as_in_the_paper(made: Callable, kind: str, type_and_size: str, taps: int, layers: int) -> None:
    network = made(kind, type_and_size, taps=taps, layers=layers)
    field_of_view, heard, rows = team(7)
    logits = network(field_of_view, heard).detach()
    expected = network_by_hand(network, network.extractor(field_of_view).tolist(), rows)
    assert logits.shape == (7, 5)
    assert logits.numpy() == pytest.approx(np.array(expected), abs=1e-9)
    # Messages change the result, unless they are empty.
    assert bool((network(field_of_view, heard[:, :0]) != logits).any()) is (taps > 1)


@pytest.mark.parametrize("kind", KINDS)
def test_k_rounds_bring_the_features_shifted_k_times(made: Callable, kind: str) -> None:
    network = made(kind, "F-3-P4", taps=4)
    field_of_view, heard, rows = team(7)
    state, present = network.perceive(field_of_view), heard >= 0
    X = state.x.tolist()
    heads = [Head(network.layers[0], p) for p in range(4)]
    expected = [powers(head.shift(X, rows), X, 3) for head in heads]
    for hops in (1, 2, 3):
        state = network.hear(state, network.message(state)[heard.clamp_min(0)], present)
        if hops == 3:
            break  # after its last hop a layer keeps no aggregate
        assert state.aggregated is not None
        aggregated = state.aggregated.expand(-1, 4, -1).transpose(0, 1).tolist()
        assert np.array(aggregated) == pytest.approx(np.array([powers[hops] for powers in expected]), abs=1e-12)
        message = network.message(state)
        # E is the same in every hop: with attention, receivers compute it again from x.
        parts = [] if kind.startswith("GNN") else [state.x]
        own = state.aggregated.flatten(1)
        assert torch.equal(message, torch.cat([*parts, own], dim=1))


@pytest.fixture(params=["F-5", "F-5-P4"], ids=["P=1", "P=4"])
def size(request: pytest.FixtureRequest) -> str:
    return request.param


def spread(layer: GraphLayer, receivers: int = 6, places: int = 5) -> tuple[torch.Tensor, ...]:
    """Features so large that outputs are clamped at both ends, and some places without a message."""
    generator = torch.Generator().manual_seed(1)
    x = 4 * torch.rand(receivers, layer.inputs, generator=generator, dtype=torch.float64)
    keys = 4 * torch.rand(receivers, places, layer.inputs, generator=generator, dtype=torch.float64)
    present = torch.rand(receivers, places, generator=generator) < 0.7
    present[0] = False
    present[1] = True
    return x, keys, present


@pytest.mark.parametrize("kind", KINDS)
def test_a_receiver_weighs_what_it_hears_by_that_and_by_its_own(made: Callable, kind: str, size: str) -> None:
    layer = made(kind, size).layers[0]
    x, keys, present = spread(layer)
    weights, total = layer.attention(x, keys, present)
    e = (weights / total).detach()
    assert e.shape == (6, layer.heads, 5)
    assert not e[~present[:, None, :].expand_as(e)].any()
    scores = []
    for i in range(6):
        heard = keys[i, present[i]].tolist()
        for p in range(layer.heads):
            head = Head(layer, p)
            assert e[i, p, present[i]].numpy() == pytest.approx(head.weights(x[i].tolist(), heard), abs=1e-12)
            if not kind.startswith("GNN"):
                scores += [head.score(x[i].tolist(), x_j) for x_j in heard]
    if scores:
        assert min(scores) < -0.1 < 0.1 < max(scores)  # both branches of the LeakyReLU are used
        assert e[1].std(dim=1).min() > 0.01  # the weights differ


@pytest.mark.parametrize("kind", KINDS)
def test_later_rounds_bring_what_others_heard_weighed_by_the_same_attention(
    made: Callable, kind: str, size: str
) -> None:
    layer = made(kind, size, taps=3).layers[0]
    x, keys, present = spread(layer)
    # With attention each head has its own aggregate; without, all heads share one.
    different = 1 if kind.startswith("GNN") else layer.heads
    values = torch.rand(6, 5, different, layer.inputs, generator=torch.Generator().manual_seed(2)).double()
    messages = values.flatten(2) if kind.startswith("GNN") else torch.cat([keys, values.flatten(2)], dim=2)
    aggregated = layer.receive(x, messages, present).detach().expand(-1, layer.heads, -1)
    for i in range(6):
        for p in range(layer.heads):
            weights = Head(layer, p).weights(x[i].tolist(), keys[i, present[i]].tolist())
            heard = values[i, present[i], p % different].tolist()
            expected = [sum(w * v[f] for w, v in zip(weights, heard, strict=True)) for f in range(layer.inputs)]
            assert aggregated[i, p].numpy() == pytest.approx(expected, abs=1e-12)
    # Messages of later hops are longer with attention, and must be distinguished from those of the first hop.
    assert messages.shape[2] == layer.message(x, aggregated[:, :different]).shape[1]


@pytest.mark.parametrize("kind", KINDS)
def test_without_neighbours_only_the_own_term_is_left(made: Callable, kind: str, size: str) -> None:
    network = made(kind, size, taps=3)
    field_of_view, _, _ = team(6)
    X = network.perceive(field_of_view).x.tolist()
    expected = np.array(layer_by_hand(network.layers[0], X, [[]] * 6))
    for places in (0, 3):
        state = network.perceive(field_of_view)
        present = torch.zeros(6, places, dtype=torch.bool)
        for number in network.config.message_sizes:
            state = network.hear(state, torch.ones(6, places, number, dtype=torch.float64), present)
        assert state.x.detach().numpy() == pytest.approx(expected, abs=1e-12)
    assert expected.max() > 0.1


@pytest.mark.parametrize(
    ("kind", "parameter", "rows"),
    [
        pytest.param("MAGAT", "query.weight", np.s_[10:15], id="MAGAT's W"),
        pytest.param("GAT", "pair", np.s_[0, 2], id="GAT's H, receiver"),
        pytest.param("GAT", "pair", np.s_[1, 2], id="GAT's H, sender"),
        *(pytest.param(kind, "own.weight", np.s_[10:15], id=f"A_0 of {kind}") for kind in KINDS),
        *(pytest.param(kind, "taps", np.s_[0, 2], id=f"A_1 of {kind}") for kind in KINDS),
        *(pytest.param(kind, "taps", np.s_[1, 2], id=f"A_2 of {kind}") for kind in KINDS),
    ],
)
def test_heads_are_independent_and_stand_one_after_the_other(
    made: Callable, kind: str, parameter: str, rows: object
) -> None:
    network = made(kind, "F-5-P4", taps=3)
    field_of_view, heard, _ = team(9)

    def fused() -> torch.Tensor:
        state = network.perceive(field_of_view)
        for _ in range(network.rounds):
            state = network.hear(state, network.message(state)[heard.clamp_min(0)], heard >= 0)
        return state.x

    before = fused()
    with torch.no_grad():
        network.layers[0].get_parameter(parameter)[rows] *= -3  # of head 2
    changed = (fused() != before).any(dim=0).unflatten(0, (4, 5)).any(dim=1)
    assert changed.tolist() == [False, False, True, False]


@pytest.mark.parametrize("kind", KINDS)
def test_only_the_bottleneck_carries_the_robots_own_features_past_the_exchange(made: Callable, kind: str) -> None:
    field_of_view, heard, _ = team(4)
    for size, width, reaches in (("F-6-P4", 24, False), ("B-6-P4", 24 + 128, True)):
        network = made(kind, size)
        assert network.hidden.in_features == width

        def logits(state: NodeState, network: PolicyNetwork = network) -> torch.Tensor:
            messages = network.message(state)[heard.clamp_min(0)]
            return network.logits(network.hear(state, messages, heard >= 0))

        seen = network.perceive(field_of_view)
        other = replace(seen, features=torch.ones_like(seen.features))
        assert bool((logits(seen) != logits(other)).any()) is reaches


@pytest.mark.parametrize("name", ["MAGAT-B-32", "GNN_baseline-F-32"])
def test_looking_gives_128_features_and_num_features_to_send(random_network: Callable, name: str) -> None:
    network = random_network(name)
    state = network.perceive((torch.rand(4, 3, 11, 11) < 0.2).float())
    assert state.features.shape == (4, 128)
    assert network.message(state).shape == state.x.shape == (4, 32)


def test_what_each_round_sends_has_the_size_that_the_configuration_says(
    random_network: Callable, variant: dict
) -> None:
    network = random_network(**variant)
    state = network.perceive((torch.rand(3, 3, 11, 11) < 0.2).float())
    sent = []
    for _ in range(network.rounds):
        message = network.message(state)
        sent.append(message.shape[1])
        state = network.hear(state, message[None].expand(3, -1, -1), torch.ones(3, 3, dtype=torch.bool))
    assert tuple(sent) == network.config.message_sizes
    assert network.logits(state).shape == (3, 5)


def test_every_weight_can_be_learned(random_network: Callable, variant: dict) -> None:
    network = random_network(**variant).train()
    field_of_view, heard, _ = team(12)
    logits = network(field_of_view.float(), heard)
    torch.nn.functional.cross_entropy(logits, torch.arange(12) % 5).backward()
    for name, parameter in network.named_parameters():
        silent = network.config.taps == 1 and name.endswith(("taps", "pair", "query.weight"))
        assert silent or (parameter.grad is not None and parameter.grad.any()), name


def test_a_sum_over_more_neighbours_than_its_limit_is_cut_off_alike_in_training(made: Callable) -> None:
    layer = made("GNN, bare", "F-5").layers[0]
    messages, present = torch.full((1, 300, 5), 8.0).double(), torch.ones(1, 300, dtype=torch.bool)
    assert (layer.receive(messages[:, 0], messages, present) == 2048).all()
    assert (layer.receive(messages[:, 0], messages[:, :200], present[:, :200]) == 1600).all()
