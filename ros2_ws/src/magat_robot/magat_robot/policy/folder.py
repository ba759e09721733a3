# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The files of one policy folder: their names, reading and checking them, copying them. Free of torch.

`store` saves and loads the weights in them with torch; `models` finds policy folders by name.
"""

import hashlib
import json
import math
import re
from collections.abc import Mapping
from pathlib import Path

from magat_node.files import write_atomically
from magat_robot.policy.config import ModelError, PolicyConfig

WEIGHTS, CONFIG, CARD = "model.safetensors", "config.json", "card.md"
#: Subfolder for the exported policy (`magat_robot.policy.export`).
EXPORT = "onnx"
#: File in it that lists the parts, with their digests and that of the weights they were exported from.
CONTENTS = "contents.json"
#: Raised when the parts get other inputs or outputs.
EXPORT_VERSION = 2
# Names of tensors, and of the header's own entry, that are not weights.
_UNTRAINED = re.compile(r"\.(running_(mean|var)|num_batches_tracked)$|^__metadata__$")
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
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise ModelError(f"{config_file} is damaged ({error!r}): write it again or fetch the policy again") from error
    data = weights_file.read_bytes()
    digest = hashlib.sha256(data).hexdigest()
    if digest != expected:
        raise ModelError(
            f"{weights_file} is damaged or of another policy: its SHA-256 is {digest}, and {CONFIG} says {expected}; "
            "fetch the policy again"
        )
    return config, digest, data


def read_temperature(folder: Path, shield: str) -> float:
    """The sampling temperature of the policy in ``folder`` with ``shield``.

    ``config.json`` may have ``temperatures``, by shield, beside the policy's configuration. The configuration's own
    ``temperature`` holds for all other shields, and for robots that do not know the simulator's shield.

    Raises:
        ModelError: a file is missing or damaged, or the temperature is no number.
    """
    config, _, _ = read_folder(folder)
    temperatures = json.loads((folder / CONFIG).read_text()).get("temperatures", {})
    value = temperatures.get(shield, config.temperature) if isinstance(temperatures, dict) else None
    if type(value) not in (int, float):
        raise ModelError(f"{folder / CONFIG}: temperatures is {temperatures!r}: give a number for each shield")
    return config.with_changes(temperature=value).temperature


def write_temperatures(folder: Path, temperatures: Mapping[str, float], default: str) -> None:
    """Keep the sampling ``temperatures`` of a policy, by shield, in its folder, see `read_temperature`.

    Args:
        folder: of the policy.
        temperatures: by shield; those of other shields stay.
        default: the shield whose temperature also becomes the configuration's own.

    Raises:
        ModelError: a file is missing or damaged, or a temperature is out of range.
    """
    config, _, _ = read_folder(folder)
    for temperature in temperatures.values():
        config.with_changes(temperature=temperature)
    stored = json.loads((folder / CONFIG).read_text())
    stored["temperatures"] = stored.get("temperatures", {}) | temperatures
    stored["policy"]["temperature"] = temperatures.get(default, config.temperature)
    with write_atomically(folder / CONFIG) as draft:
        draft.write_text(json.dumps(stored, indent=2) + "\n")


def count_weights(folder: Path) -> int:
    """How many trained weights the policy in ``folder`` has; the statistics of its normalisation do not count.

    Raises:
        ModelError: a file is missing or damaged.
    """
    _, _, data = read_folder(folder)
    try:
        # A safetensors file begins with the length of its header, which is JSON: the shape of each tensor by name.
        size = int.from_bytes(data[:8], "little")
        header = json.loads(data[8 : 8 + size])
        shapes = [tensor["shape"] for name, tensor in header.items() if not _UNTRAINED.search(name)]
        return sum(math.prod(shape) for shape in shapes)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ModelError(f"{folder / WEIGHTS} is no safetensors file ({error!r}): fetch the policy again") from error


def part_names(rounds: int) -> list[str]:
    """The files of an exported policy, in the order in which they run in a tick; the last one also gives weights."""
    return ["perceive.onnx", *(f"hear_{number}.onnx" for number in range(rounds))]


def read_export(folder: Path, digest: str, rounds: int) -> list[bytes]:
    """The parts of the exported policy in ``folder``, in the order of `part_names`.

    Args:
        folder: policy folder.
        digest: of the weights.
        rounds: of messages in a tick.

    Raises:
        ModelError: the policy was not exported, or is damaged, or was exported from other weights.
    """
    advice = "export the policy with `magat export`"
    path = folder / EXPORT
    try:
        contents = json.loads((path / CONTENTS).read_text())
        parts = {name: (path / name).read_bytes() for name in part_names(rounds)}
        intact = contents["files"] == {name: hashlib.sha256(data).hexdigest() for name, data in parts.items()}
        exported, version = contents["weights"], contents.get("version", 1)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ModelError(f"{path} cannot be used ({error!r}): {advice}") from error
    if version != EXPORT_VERSION:
        raise ModelError(f"{path} is of version {version}, and robots need {EXPORT_VERSION}: {advice}")
    if not intact:
        raise ModelError(f"{path} is damaged: {advice}")
    if exported != digest:
        raise ModelError(f"{path} was exported from the weights {exported[:12]}, and these are {digest[:12]}: {advice}")
    return list(parts.values())


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
