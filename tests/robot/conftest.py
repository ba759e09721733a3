# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Shared by the tests of policies: the policies that they run for."""

import pytest
import torch

from magat_robot.policy.layers import LAYERS

#: Each kind of layer, with combinations of heads, hops, layers and types B and F.
VARIANTS = {
    "MAGAT-F-16": {},
    "MAGAT-B-8-P4": {"cnn": "centred"},
    "MAGAT-F-8-P3": {"taps": 3, "layers": 2},
    "GAT-F-16": {},
    "GAT-B-8-P3": {"taps": 3, "layers": 2},
    "GAT-F-8": {"taps": 1, "layers": 2},
    "GNN-F-16": {},
    "GNN-B-8-P3": {"taps": 3, "layers": 2, "normalise": False},
    "GNN_baseline-F-16": {"taps": 3},
}
#: Registered layers that are not listed above, so that the tests also run for a new layer.
VARIANTS |= {
    f"{name}-B-8-P3": {"taps": 3, "layers": 2}
    for name in LAYERS
    if not any(variant.startswith(f"{name}-") for variant in VARIANTS)
}


@pytest.fixture(scope="session", autouse=True)
def _one_thread() -> None:
    # The networks are small: one thread is fastest.
    torch.set_num_threads(1)


@pytest.fixture(scope="session", params=VARIANTS)
def variant(request: pytest.FixtureRequest) -> dict:
    """Arguments of `random_network` and `small_policy`: the policy's name and its non-default settings."""
    return {"name": request.param} | VARIANTS[request.param]
