"""What the tests of policies share: which policies they are held for, and how these compute."""

import pytest
import torch

#: One of each kind, and what can go wrong together: heads, hops, layers, the robot's own features.
VARIANTS = {
    "MAGAT-F-16": {},
    "MAGAT-B-8-P4": {},
    "MAGAT-F-8-P3": {"taps": 3, "layers": 2},
    "GAT-F-16": {},
    "GAT-B-8-P3": {"taps": 3, "layers": 2},
    "GAT-F-8": {"taps": 1, "layers": 2},
    "GNN-F-16": {},
    "GNN-B-8-P3": {"taps": 3, "layers": 2, "normalise": False},
    "GNN_baseline-F-16": {"taps": 3},
}


@pytest.fixture(scope="session", autouse=True)
def _one_thread() -> None:
    # Networks are small here: one thread computes them fastest.
    torch.set_num_threads(1)


@pytest.fixture(scope="session", params=VARIANTS)
def variant(request: pytest.FixtureRequest) -> dict:
    """What makes a policy, for `random_network` and `small_policy`: its name, and what else is not as by default."""
    return {"name": request.param} | VARIANTS[request.param]
