"""A policy on a robot, computed by the library that the robot has."""

from pathlib import Path
from typing import Any

from magat_robot.policy.interface import RobotPolicy

#: torch is the reference; onnx (onnxruntime) decides alike to the last bit, several times faster, in less memory; echo
#: computes nothing, to measure what all the rest costs.
BACKENDS = ("torch", "onnx", "echo")


def preload(backend: str) -> None:
    """Import the library of ``backend``, for processes to be forked; it does not compute yet."""
    if backend == "onnx":
        import onnxruntime  # noqa: F401
    elif backend == "torch":
        import torch  # noqa: F401


def load_policy(folder: Path, backend: str = "torch", **changes: Any) -> RobotPolicy:
    """The policy in ``folder``, ready to decide, in one thread.

    Args:
        folder: of the policy; for the backend onnx it has been exported.
        backend: one of `BACKENDS`.
        changes: fields of its configuration that are a matter of its deployment: temperature, encoding.

    Raises:
        ModelError: the policy cannot be used.
    """
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
