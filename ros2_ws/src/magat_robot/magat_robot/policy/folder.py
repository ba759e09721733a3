"""The files of one policy folder: their names, reading and checking them, copying them. Free of torch.

`store` saves and loads the weights in them with torch; `models` finds policy folders by name.
"""

import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path

from magat_robot.policy.config import ModelError, PolicyConfig

WEIGHTS, CONFIG, CARD = "model.safetensors", "config.json", "card.md"
#: Subfolder for the exported policy (`magat_robot.policy.export`).
EXPORT = "onnx"
_EXPORTED = re.compile(rf"{EXPORT}/\w[\w.]*")


def read_folder(folder: Path) -> tuple[PolicyConfig, str, bytes]:
    """The configuration in ``folder``, the digest of the weights (SHA-256, hexadecimal), and the weights' file.

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
            f"{weights_file} is damaged or of another policy: its SHA-256 is {digest}, and {CONFIG} says {expected}; "
            "fetch the policy again"
        )
    return config, digest, data


def read_files(folder: Path) -> dict[str, bytes]:
    """The files in ``folder`` that a robot needs, by their relative paths: configuration, weights, exported policy.

    Raises:
        ModelError: ``folder`` is no policy folder, or is damaged.
    """
    read_folder(folder)
    export = sorted(file for file in (folder / EXPORT).glob("*") if file.is_file())
    files = [folder / CONFIG, folder / WEIGHTS, *export]
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in files}


def write_files(files: Mapping[str, bytes], folder: Path) -> None:
    """Write the files that `read_files` returned to ``folder``.

    Raises:
        ModelError: a name is not that of a file in a policy folder, e.g. it leads out of the folder.
    """
    for name in files:
        if name not in (CONFIG, WEIGHTS) and not _EXPORTED.fullmatch(name):
            raise ModelError(f"a policy folder has no file {name!r}: it has {CONFIG}, {WEIGHTS} and {EXPORT}/")
    (folder / EXPORT).mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        (folder / name).write_bytes(data)
