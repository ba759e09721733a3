"""The backend onnx: onnxruntime computes the same bits as torch, several times faster for one robot, without torch.

It reads the files that `magat_robot.policy.export` writes. All sums are exact (see `fixed_point`), so the order in
which a library adds does not matter.
"""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import onnxruntime

from magat_robot.policy.config import ModelError
from magat_robot.policy.folder import EXPORT, read_folder
from magat_robot.policy.interface import Decision, LatentState, check_field_of_view
from magat_robot.policy.sampling import choose, uniform

#: File that lists the parts, with their digests and that of the weights they were exported from.
CONTENTS = "contents.json"
#: Names of the inputs and outputs of the parts, besides those of the state.
FIELD_OF_VIEW = "field_of_view"
MESSAGE = "message"
MESSAGES = "messages"
PRESENT = "present"
TEMPERATURE = "temperature"
WEIGHTS = "weights"
#: Prefix of all outputs' names: in one ONNX graph, an input and an output cannot share a name.
OUTPUT = "output_"


def part_names(rounds: int) -> list[str]:
    """The files of an exported policy, in the order in which they run in a tick; the last one also gives weights."""
    return ["perceive.onnx", *(f"hear_{number}.onnx" for number in range(rounds))]


class _Part:
    """A loaded part of the exported policy: a function from named tensors to named tensors."""

    def __init__(self, data: bytes, options: onnxruntime.SessionOptions) -> None:
        self._session = onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
        self._inputs = [value.name for value in self._session.get_inputs()]
        self._outputs = [value.name.removeprefix(OUTPUT) for value in self._session.get_outputs()]

    def __call__(self, values: dict[str, Any]) -> dict[str, Any]:
        """``values`` may hold more than the inputs."""
        results = self._session.run(None, {name: values[name] for name in self._inputs})
        return dict(zip(self._outputs, results, strict=True))


class OnnxPolicy:
    """An exported policy, computed by onnxruntime, as a `RobotPolicy`."""

    def __init__(self, folder: Path, threads: int = 1, **changes: Any) -> None:
        """Load the policy.

        Args:
            folder: policy folder; the policy was exported to its subfolder ``onnx``.
            threads: number of threads of onnxruntime.
            changes: values for the fields of its configuration that do not affect the weights: temperature, encoding.

        Raises:
            ModelError: the policy was not exported, or is damaged, or was exported from other weights.
        """
        config, self.digest, _ = read_folder(folder)
        self.config = config.with_changes(**changes)
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
        parts = _read_export(folder, self.digest, part_names(len(config.message_sizes)))
        try:
            self._parts = [_Part(data, options) for data in parts]
        except Exception as error:  # onnxruntime's errors have no other common base
            raise ModelError(f"onnxruntime cannot load {folder / EXPORT}: {error}") from error
        self._temperature = np.array(self.config.temperature)

    def perceive(self, field_of_view: npt.NDArray[np.uint8]) -> LatentState:
        """See `RobotPolicy.perceive`."""
        check_field_of_view(field_of_view)
        return self._next(0, {FIELD_OF_VIEW: field_of_view.astype(np.float32)})

    def hear(self, own: LatentState, messages: npt.NDArray[np.float32], present: npt.NDArray[np.bool_]) -> LatentState:
        """See `RobotPolicy.hear`."""
        if messages.shape[1] == 0:  # the operators need at least one place; an empty one does not change the result
            messages, present = np.pad(messages, ((0, 0), (0, 1), (0, 0))), np.pad(present, ((0, 0), (0, 1)))
        heard = np.where(present[:, :, None], messages, np.float32(0)).astype(np.float64)
        return self._next(own.state["part"], own.state | {MESSAGES: heard, PRESENT: present})

    def decide(self, own: LatentState, streams: npt.NDArray[np.uint64], tick: int) -> Decision:
        """See `RobotPolicy.decide`."""
        weights = own.state[WEIGHTS]
        return Decision(weights, choose(weights, uniform(streams, tick)))

    def _next(self, part: int, values: dict[str, Any]) -> LatentState:
        state = self._parts[part](values | {TEMPERATURE: self._temperature})
        # The last part gives weights, and no message.
        message = state.pop(MESSAGE) if MESSAGE in state else np.zeros((len(state[WEIGHTS]), 0))
        return LatentState(state | {"part": part + 1}, message.astype(np.float32))


def _read_export(folder: Path, digest: str, names: list[str]) -> list[bytes]:
    advice = "export the policy with `magat export`"
    path = folder / EXPORT
    try:
        contents = json.loads((path / CONTENTS).read_text())
        parts = {name: (path / name).read_bytes() for name in names}
        intact = contents["files"] == {name: hashlib.sha256(data).hexdigest() for name, data in parts.items()}
        exported = contents["weights"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ModelError(f"{path} cannot be used ({error!r}): {advice}") from error
    if not intact:
        raise ModelError(f"{path} is damaged: {advice}")
    if exported != digest:
        raise ModelError(f"{path} was exported from the weights {exported[:12]}, and these are {digest[:12]}: {advice}")
    return [parts[name] for name in names]
