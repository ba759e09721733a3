# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the suites share: the settings of hypothesis, random worlds, networks that look trained."""

import copy
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

# The same examples in every run; `--hypothesis-profile=explore` looks for new ones.
settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None)
settings.load_profile("repeatable")


@pytest.fixture(scope="session")
def random_case() -> Callable:
    """Draws a world to move in. Unlike a drawn case, its goals need not be reachable."""
    from magat_sim.case import Case

    def draw(rng: np.random.Generator, width: int, height: int, robots: int, density: float = 0.2) -> Case:
        obstacles = rng.random((height, width)) < density
        obstacles[rng.integers(height), rng.integers(width)] = False
        free = np.argwhere(~obstacles)[:, ::-1]
        return Case(obstacles, rng.permutation(free)[:robots], rng.permutation(free)[:robots])

    return draw


@pytest.fixture(scope="session")
def random_team(random_case: Callable) -> Callable:
    """Draws a simulator of several worlds, and what its robots see and hear at the start."""
    from magat_sim.simulator import Observation, Simulator
    from magat_sim.streams import episode_streams

    def draw(rng: np.random.Generator, *robots: int, side: int = 12) -> Observation:
        cases = [random_case(rng, side, side, count) for count in robots]
        streams = [episode_streams(7, number, case.robots) for number, case in enumerate(cases)]
        return Simulator(cases, [10] * len(cases), streams).observe()

    return draw


@pytest.fixture(scope="session")
def random_network() -> Callable:
    """Makes a network that looks trained: it has seen data, and every input makes a difference."""
    import torch

    from magat_robot.policy.config import PolicyConfig
    from magat_robot.policy.graph import GraphAttention, GraphConvolution, MessageAwareAttention
    from magat_robot.policy.network import PolicyNetwork

    made: dict[tuple[PolicyConfig, int], PolicyNetwork] = {}

    def make(name: str = "MAGAT-F-16", seed: int = 0, **sizes: object) -> PolicyNetwork:
        config = PolicyConfig(name, **({"channels": (8, 8, 16), "hidden": 24} | sizes))
        if (config, seed) not in made:
            made[config, seed] = trained(config, seed)
        return copy.deepcopy(made[config, seed])

    def trained(config: PolicyConfig, seed: int) -> PolicyNetwork:
        with torch.random.fork_rng(devices=[]), torch.no_grad():
            torch.manual_seed(seed)
            network = PolicyNetwork(config)
            norms = [module for module in network.modules() if isinstance(module, torch.nn.BatchNorm2d)]
            for norm in norms:
                norm.weight.uniform_(0.6, 1.6)
                norm.bias.normal_(0, 0.4)
            for layer in network.layers:
                # As built, all neighbours weigh nearly the same.
                if isinstance(layer, MessageAwareAttention):
                    layer.query.weight.normal_(0, 4.8 / layer.inputs)
                elif isinstance(layer, GraphAttention):
                    layer.pair.normal_(0, 3 / config.features**0.5)
                elif isinstance(layer, GraphConvolution) and not config.normalise:
                    # Sums over neighbours grow from hop to hop, and would drown everything else.
                    for hops, matrix in enumerate(layer.taps, start=1):
                        matrix.mul_(6.0**-hops)
            views = (torch.rand(64, 3, 11, 11) < 0.2).float()
            for norm in norms:
                norm.momentum = 1.0  # the statistics are those of the next batch
            network.extractor(views)
            for norm in norms:
                norm.momentum = 0.1
            network.eval()
            layers = (network.extractor.linear, network.reduction, network.hidden, network.action)
            hooks = [layer.register_forward_pre_hook(spread_out) for layer in layers]
            network(views, (torch.arange(64)[:, None] + torch.tensor([1, 2, 5])) % 64)
            for hook in hooks:
                hook.remove()
            return network.requires_grad_(True)

    def spread_out(layer: torch.nn.Linear, inputs: tuple[torch.Tensor]) -> None:
        # As built, activations fade from layer to layer, and hardly anything would reach the decisions.
        output = torch.nn.functional.linear(*inputs, layer.weight, layer.bias)
        scale = 1.2 / output.std(0).clamp_min(1e-3)
        layer.bias.sub_(output.mean(0)).mul_(scale).add_(0.3)
        layer.weight.mul_(scale[:, None])

    return make


@pytest.fixture(scope="session")
def small_policy(random_network: Callable) -> Callable:
    """A deployed random policy; each is made once."""
    from magat_robot.policy.policy import Policy

    made: dict[tuple, Policy] = {}

    def policy(name: str = "MAGAT-F-16", seed: int = 0, **sizes: object) -> Policy:
        key = (name, seed, *sorted(sizes.items()))
        if key not in made:
            made[key] = Policy(random_network(name, seed, **sizes))
        return made[key]

    return policy


@pytest.fixture
def policies(tmp_path: Path, random_network: Callable) -> dict[str, Path]:
    """Two policies."""
    from magat_robot.policy.store import save

    folders = {name: tmp_path / "models" / name for name in ("first", "second")}
    for seed, folder in enumerate(folders.values()):
        save(random_network("MAGAT-F-16", seed=seed), folder, "# card\n")
    return folders


@pytest.fixture(scope="session")
def needs_chromium() -> None:
    """Skips where there is no browser; `.ci/run` installs one."""
    from magat_viewer.browser import BrowserError, find_chromium

    try:
        find_chromium()
    except BrowserError as error:
        pytest.skip(f"no browser test: {error}")


@pytest.fixture
def one_thread() -> Iterator[None]:
    """What one robot computes is small: threads would only wait for each other."""
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture
def simulate(random_case: Callable, tmp_path: Path, one_thread: None) -> Callable:
    """Runs a team in this process, and writes the bag ``tmp_path / "bag"``, see `simulate_team`."""
    from simulated_team import simulate_team

    return lambda policy, *args, **options: simulate_team(policy, random_case, tmp_path / "bag", *args, **options)


@pytest.fixture(scope="session")
def solved() -> list:
    """Eight small cases with the expert's solutions, quick to solve, learn and play; crowded enough to need others."""
    from magat_evaluation.cases import solved_cases

    return list(solved_cases(range(8), workers=1, width=9, height=9, robots=5, density=0.15))
