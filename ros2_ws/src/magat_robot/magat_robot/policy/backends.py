# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The backends: makes a `RobotPolicy` of a policy folder, by the name of the library that computes it.

Other modules about policy folders: `models` finds them, `folder` reads and checks their files without torch, `store`
saves and loads weights with torch.
"""

from pathlib import Path
from typing import Any

from magat_robot.policy.computed import ComputedPolicy
from magat_robot.policy.config import ModelError
from magat_robot.policy.folder import EXPORT, read_export, read_folder
from magat_robot.policy.interface import RobotPolicy

#: What to do where torch is needed but not installed.
_NO_TORCH = "install what training needs, requirements-train.txt"

_preloaded: dict[tuple[Path, str, tuple[tuple[str, Any], ...]], RobotPolicy] = {}


def preload(folder: Path, backend: str, **changes: Any) -> None:
    """Load a policy before forking; the first `load_policy` with the same arguments in each child returns it.

    The children share its memory until they write to it, and so also the processor's cache lines: the cache holds one
    policy instead of one for each process.

    Raises:
        ModelError: the policy cannot be used.
    """
    _preloaded[_key(folder, backend, changes)] = load_policy(folder, backend, **changes)


def _key(folder: Path, backend: str, changes: dict[str, Any]) -> tuple[Path, str, tuple[tuple[str, Any], ...]]:
    return folder.resolve(), backend, tuple(sorted(changes.items()))


def load_policy(folder: Path, backend: str = "onnx", **changes: Any) -> RobotPolicy:
    """Load the policy in ``folder`` for a robot; it computes in one thread.

    Args:
        folder: policy folder; exported beforehand (`magat_robot.policy.export`) for the backend onnx.
        backend: one of `magat_robot.policy.config.BACKENDS`.
        changes: values for the fields of its configuration that do not affect the weights, see `CHANGEABLE`.

    Raises:
        ModelError: the policy cannot be used.
    """
    preloaded = _preloaded.pop(_key(folder, backend, changes), None)
    if preloaded is not None:
        return preloaded
    # Imported here, so that a robot loads one library only: each is larger than all the rest of the process.
    if backend == "onnx":
        from magat_robot.policy.onnx_policy import OnnxPolicy

        return OnnxPolicy(folder, **changes)
    if backend == "echo":
        from magat_robot.policy.echo_policy import EchoPolicy

        return EchoPolicy(folder, **changes)
    try:
        import torch

        from magat_robot.policy.store import load
    except ModuleNotFoundError as error:
        raise ModelError(f"{error}: {_NO_TORCH}, or take the backend onnx") from error
    torch.set_num_threads(1)  # a robot's computations are small: more threads would only wait for each other
    return load(folder, **changes)


def load_computed(folder: Path, **changes: Any) -> ComputedPolicy:
    """Load the policy in ``folder`` for a tool: its exported form if there is one, else its weights, with torch.

    Args:
        folder: policy folder.
        changes: see `load_policy`.

    Raises:
        ModelError: the policy cannot be used, or it is not exported and torch is not installed.
    """
    if (folder / EXPORT).is_dir():
        from magat_robot.policy.onnx_policy import OnnxPolicy

        return OnnxPolicy(folder, **changes)
    read_folder(folder)  # its errors come first
    try:
        from magat_robot.policy.store import load
    except ModuleNotFoundError as error:
        raise ModelError(f"{folder} is not exported, and {error}: {_NO_TORCH}") from error
    return load(folder, **changes)


def ensure_exported(folder: Path) -> None:
    """Export the policy in ``folder``, unless an intact export of its weights is there.

    Raises:
        ModelError: the policy cannot be used, or it is not exported and torch is not installed.
    """
    config, digest, _ = read_folder(folder)
    try:
        read_export(folder, digest, len(config.message_sizes))
    except ModelError as reason:
        try:
            from magat_robot.policy.export import export
        except ModuleNotFoundError as error:
            raise ModelError(f"{reason}; {error}: {_NO_TORCH}") from error
        export(folder)
