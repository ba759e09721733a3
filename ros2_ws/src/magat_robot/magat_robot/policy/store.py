"""Policy folders: ``model.safetensors`` (weights), ``config.json``, ``card.md`` (how it was trained, for people)."""

import hashlib
import json
from pathlib import Path

from safetensors import SafetensorError
from safetensors.torch import load as load_tensors
from safetensors.torch import save as save_tensors

from magat_robot.policy.config import ModelError, PolicyConfig
from magat_robot.policy.network import PolicyNetwork
from magat_robot.policy.policy import Policy

WEIGHTS, CONFIG, CARD = "model.safetensors", "config.json", "card.md"


def save(network: PolicyNetwork, folder: Path, card: str) -> str:
    """Write ``network`` and its ``card`` to ``folder``; returns the digest of the weights (SHA-256, hexadecimal)."""
    folder.mkdir(parents=True, exist_ok=True)
    weights = save_tensors({name: tensor.contiguous() for name, tensor in network.state_dict().items()})
    digest = hashlib.sha256(weights).hexdigest()
    (folder / WEIGHTS).write_bytes(weights)
    config = {"policy": network.config.to_json(), "sha256": digest}
    (folder / CONFIG).write_text(json.dumps(config, indent=2) + "\n")
    (folder / CARD).write_text(card)
    return digest


def load_network(folder: Path) -> tuple[PolicyNetwork, str]:
    """The network in ``folder``, as trained, and the digest of its weights.

    Raises:
        ModelError: a file is missing, damaged, or not of this configuration.
    """
    config_file, weights_file = folder / CONFIG, folder / WEIGHTS
    for file in (config_file, weights_file):
        if not file.is_file():
            raise ModelError(f"{folder} is no policy folder: {file.name} is missing")
    try:
        stored = json.loads(config_file.read_text())
        config, expected = PolicyConfig.from_json(stored["policy"]), stored["sha256"]
    except ModelError as error:
        raise ModelError(f"{config_file}: {error}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise ModelError(f"{config_file} is damaged ({error!r}): write it again or fetch the policy again") from error
    data = weights_file.read_bytes()
    digest = hashlib.sha256(data).hexdigest()
    if digest != expected:
        raise ModelError(
            f"{weights_file} is damaged or of another policy: its SHA-256 is {digest}, and {CONFIG} says {expected}"
        )
    network = PolicyNetwork(config)
    try:
        network.load_state_dict(load_tensors(data))
    except (SafetensorError, RuntimeError) as error:
        raise ModelError(f"{weights_file} does not hold the weights of a {config.name}: {error}") from error
    return network, digest


def load(folder: Path) -> Policy:
    """The policy in ``folder``, ready to decide.

    Raises:
        ModelError: as `load_network`, or weights that are not finite or too large for exact sums.
    """
    network, digest = load_network(folder)
    try:
        return Policy(network, digest)
    except ValueError as error:
        raise ModelError(f"{folder / WEIGHTS} cannot be deployed: {error}") from error
