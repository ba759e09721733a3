# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Saves networks to policy folders and loads them, with torch.

A policy folder holds ``model.safetensors`` (weights), ``config.json`` and ``card.md`` (how it was trained, for people).
`folder` reads and checks the same files without torch.
"""

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

from safetensors import SafetensorError
from safetensors.torch import load as load_tensors
from safetensors.torch import save as save_tensors

from magat_robot.policy.config import ModelError
from magat_robot.policy.folder import CARD, CONFIG, EXPORT, WEIGHTS, read_folder
from magat_robot.policy.network import PolicyNetwork
from magat_robot.policy.policy import Policy

__all__ = ["CARD", "CONFIG", "WEIGHTS", "load", "load_network", "save"]


def save(network: PolicyNetwork, folder: Path, card: str) -> str:
    """Write ``network`` and its ``card`` to ``folder``; returns the digest of the weights (SHA-256, hexadecimal).

    The exported form of earlier weights is removed: `magat_robot.policy.export` makes that of these.
    """
    folder.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(folder / EXPORT, ignore_errors=True)
    weights = save_tensors({name: tensor.contiguous() for name, tensor in network.state_dict().items()})
    digest = hashlib.sha256(weights).hexdigest()
    (folder / WEIGHTS).write_bytes(weights)
    config = {"policy": network.config.to_json(), "sha256": digest}
    (folder / CONFIG).write_text(json.dumps(config, indent=2) + "\n")
    (folder / CARD).write_text(card)
    return digest


def load_network(folder: Path) -> tuple[PolicyNetwork, str]:
    """The network in ``folder`` as trained, and the digest of its weights (SHA-256, hexadecimal).

    Raises:
        ModelError: a file is missing, damaged, or not of this configuration.
    """
    config, digest, data = read_folder(folder)
    network = PolicyNetwork(config)
    try:
        network.load_state_dict(load_tensors(data))
    except (SafetensorError, RuntimeError) as error:
        raise ModelError(f"{folder / WEIGHTS} does not hold the weights of a {config.name}: {error}") from error
    return network, digest


def load(folder: Path, **changes: Any) -> Policy:
    """The policy in ``folder``, in fixed point.

    Args:
        folder: policy folder.
        changes: values for the fields of its configuration that do not affect the weights, see `CHANGEABLE`.

    Raises:
        ModelError: as `load_network`; or a change is out of range; or the weights are not finite, or too large for
            exact sums.
    """
    network, digest = load_network(folder)
    network.config = network.config.with_changes(**changes)
    try:
        return Policy(network, digest)
    except ValueError as error:
        raise ModelError(f"{folder / WEIGHTS} cannot be used: {error}") from error
