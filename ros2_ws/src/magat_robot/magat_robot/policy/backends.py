"""The backends: makes a `RobotPolicy` of a policy folder, by the name of the library that computes it.

Other modules about policy folders: `models` finds them, `folder` reads and checks their files without torch, `store`
saves and loads weights with torch.
"""

from pathlib import Path
from typing import Any

from magat_robot.policy.interface import RobotPolicy

#: torch is the reference. onnx (onnxruntime) computes the same bits, several times faster and in less memory. echo
#: computes nothing: it measures the cost of everything else.
BACKENDS = ("torch", "onnx", "echo")

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


def load_policy(folder: Path, backend: str = "torch", **changes: Any) -> RobotPolicy:
    """Load the policy in ``folder``; it computes in one thread.

    Args:
        folder: policy folder; exported beforehand (`magat_robot.policy.export`) for the backend onnx.
        backend: one of `BACKENDS`.
        changes: values for the fields of its configuration that do not affect the weights: temperature, encoding.

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
    import torch

    from magat_robot.policy.store import load

    torch.set_num_threads(1)  # a robot's computations are small: more threads would only wait for each other
    return load(folder, **changes)
