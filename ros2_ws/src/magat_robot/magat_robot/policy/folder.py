"""What is in a policy's folder, and whether it is whole. Free of torch."""

import hashlib
import json
from pathlib import Path

from magat_robot.policy.config import ModelError, PolicyConfig

WEIGHTS, CONFIG, CARD = "model.safetensors", "config.json", "card.md"


def read_folder(folder: Path) -> tuple[PolicyConfig, str, bytes]:
    """The configuration in ``folder``, the digest of its weights, and these weights as they are stored.

    Raises:
        ModelError: a file is missing or damaged.
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
    return config, digest, data
