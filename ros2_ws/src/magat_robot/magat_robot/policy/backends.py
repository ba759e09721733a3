"""A policy on a robot, computed by the library that the robot has."""

from pathlib import Path
from typing import Any

from magat_robot.policy.interface import RobotPolicy

#: torch is the reference; onnx (onnxruntime) decides alike to the last bit, several times faster, in less memory; echo
#: computes nothing, to measure what all the rest costs.
BACKENDS = ("torch", "onnx", "echo")

_preloaded: dict[tuple[Path, str, tuple[tuple[str, Any], ...]], RobotPolicy] = {}


def preload(folder: Path, backend: str, **changes: Any) -> None:
    """Load a policy for processes to be forked, as `load_policy` does, whose first call with these arguments finds it.

    Each process has its own copy, in memory that is shared as long as nobody writes to it. So it is shared in the
    processor's caches, too, which hold one policy, and not those of ten robots.

    Raises:
        ModelError: the policy cannot be used.
    """
    _preloaded[_key(folder, backend, changes)] = load_policy(folder, backend, **changes)


def _key(folder: Path, backend: str, changes: dict[str, Any]) -> tuple[Path, str, tuple[tuple[str, Any], ...]]:
    return folder.resolve(), backend, tuple(sorted(changes.items()))


def load_policy(folder: Path, backend: str = "torch", **changes: Any) -> RobotPolicy:
    """The policy in ``folder``, ready to decide, in one thread.

    Args:
        folder: of the policy; for the backend onnx it has been exported.
        backend: one of `BACKENDS`.
        changes: fields of its configuration that are a matter of its deployment: temperature, encoding.

    Raises:
        ModelError: the policy cannot be used.
    """
    preloaded = _preloaded.pop(_key(folder, backend, changes), None)
    if preloaded is not None:
        return preloaded
    # Each backend is imported only where it is used: either is larger than all the rest of a robot.
    if backend == "onnx":
        from magat_robot.policy.onnx_policy import OnnxPolicy

        return OnnxPolicy(folder, **changes)
    if backend == "echo":
        from magat_robot.policy.echo_policy import EchoPolicy

        return EchoPolicy(folder, **changes)
    import torch

    from magat_robot.policy.store import load

    torch.set_num_threads(1)  # what a robot computes is small: threads would only wait for each other
    return load(folder, **changes)
