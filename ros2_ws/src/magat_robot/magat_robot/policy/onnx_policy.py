# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The backend onnx: onnxruntime computes the same bits as torch, without torch.

For one robot it is several times faster. It reads the files that `magat_robot.policy.export` writes. All sums are exact
(see `fixed_point`), so the order in which a library adds does not matter.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import onnxruntime

from magat_robot.policy.computed import ComputedPolicy
from magat_robot.policy.config import ModelError
from magat_robot.policy.folder import EXPORT, read_export, read_folder
from magat_robot.policy.interface import CHUNK, LatentState, check_field_of_view

#: Names of the inputs and outputs of the parts, besides those of the state.
ATTENTION = "attention"
FIELD_OF_VIEW = "field_of_view"
MESSAGE = "message"
MESSAGES = "messages"
PRESENT = "present"
TEMPERATURE = "temperature"
WEIGHTS = "weights"
#: Prefix of all outputs' names: in one ONNX graph, an input and an output cannot share a name.
OUTPUT = "output_"

_Values = dict[str, npt.NDArray[Any]]


@dataclass(frozen=True)
class OnnxState:
    """What the parts run so far have put out for R robots; the same as in `NodeState`, and the weights at the end."""

    #: Rounds of messages processed so far in this tick.
    rounds: int
    features: npt.NDArray[np.float64] | None = None
    x: npt.NDArray[np.float64] | None = None
    total: npt.NDArray[np.float64] | None = None
    aggregated: npt.NDArray[np.float64] | None = None
    #: ``[R, 5]``, after the last round only.
    weights: npt.NDArray[np.float64] | None = None

    @property
    def values(self) -> _Values:
        """The arrays by name."""
        values = {field.name: getattr(self, field.name) for field in fields(self) if field.name != "rounds"}
        return {name: value for name, value in values.items() if value is not None}


class _Part:
    """A loaded part of the exported policy: a function from named arrays to named arrays."""

    def __init__(self, data: bytes, options: onnxruntime.SessionOptions) -> None:
        self._session = onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
        self._inputs = [value.name for value in self._session.get_inputs()]
        outputs = [value.name.removeprefix(OUTPUT) for value in self._session.get_outputs()]
        self._outputs = [name for name in outputs if name != ATTENTION]

    def __call__(self, values: _Values) -> _Values:
        """All outputs but attention; ``values`` may hold more than the inputs."""
        return dict(zip(self._outputs, self._run(values, self._outputs), strict=True))

    def attention(self, values: _Values) -> npt.NDArray[np.float64]:
        """The output attention; ``values`` may hold more than the inputs."""
        return self._run(values, [ATTENTION])[0]

    def _run(self, values: _Values, outputs: list[str]) -> list[npt.NDArray[Any]]:
        return self._session.run([OUTPUT + name for name in outputs], {name: values[name] for name in self._inputs})


class OnnxPolicy(ComputedPolicy):
    """An exported policy, computed by onnxruntime."""

    def __init__(self, folder: Path, threads: int = 1, **changes: Any) -> None:
        """Load the policy.

        Args:
            folder: policy folder; the policy was exported to its subfolder ``onnx``.
            threads: number of threads of onnxruntime.
            changes: values for the fields of its configuration that do not affect the weights, see `CHANGEABLE`.

        Raises:
            ModelError: the policy was not exported, or is damaged, or was exported from other weights.
        """
        config, digest, _ = read_folder(folder)
        super().__init__(config.with_changes(**changes), digest)
        self._load_again = partial(OnnxPolicy, folder, threads, **changes)
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
        parts = read_export(folder, digest, self.rounds)
        try:
            self._parts = [_Part(data, options) for data in parts]
        except Exception as error:  # onnxruntime's errors have no other common base
            raise ModelError(f"onnxruntime cannot load {folder / EXPORT}: {error}") from error
        self._temperature = {TEMPERATURE: np.array(self.config.temperature)}

    def __reduce__(self) -> tuple[Callable[[], "OnnxPolicy"], tuple[()]]:
        """Another process loads the files again, because onnxruntime's sessions cannot be pickled."""
        return self._load_again, ()

    def perceive(self, field_of_view: npt.NDArray[np.uint8]) -> LatentState:
        """See `RobotPolicy.perceive`."""
        check_field_of_view(field_of_view)
        inputs = field_of_view.astype(np.float32)
        starts = range(0, max(1, len(inputs)), CHUNK)
        chunks = [self._parts[0]({FIELD_OF_VIEW: inputs[start : start + CHUNK]}) for start in starts]
        outputs = chunks[0]
        if len(chunks) > 1:
            outputs = {name: np.concatenate([chunk[name] for chunk in chunks]) for name in outputs}
        return _latent_state(0, outputs)

    def hear(self, own: LatentState, messages: npt.NDArray[np.float32], present: npt.NDArray[np.bool_]) -> LatentState:
        """See `RobotPolicy.hear`."""
        rounds = own.state.rounds + 1
        return _latent_state(rounds, self._parts[rounds](self._heard(own, messages, present)))

    def attention(
        self, own: LatentState, messages: npt.NDArray[np.float32], present: npt.NDArray[np.bool_]
    ) -> npt.NDArray[np.float64]:
        """See `ComputedPolicy.attention`."""
        if not self.config.communicates:
            raise ValueError(f"{self.config.name} has one tap (K = 1): its robots send no messages to attend to")
        part = self._parts[own.state.rounds + 1]
        return part.attention(self._heard(own, messages, present))[:, :, : messages.shape[1]]

    def weights(self, own: LatentState) -> npt.NDArray[np.float64]:
        """See `ComputedPolicy.weights`."""
        return own.state.weights

    def _heard(
        self, own: LatentState, messages: npt.NDArray[np.float32], present: npt.NDArray[np.bool_]
    ) -> dict[str, Any]:
        """The inputs of the next part."""
        if messages.shape[1] == 0:  # the operators need at least one place; an empty one does not change the result
            messages, present = np.pad(messages, ((0, 0), (0, 1), (0, 0))), np.pad(present, ((0, 0), (0, 1)))
        heard = np.where(present[:, :, None], messages, np.float32(0)).astype(np.float64)
        return own.state.values | {MESSAGES: heard, PRESENT: present} | self._temperature


def _latent_state(rounds: int, outputs: _Values) -> LatentState:
    # The last part gives weights, and no message.
    message = outputs.pop(MESSAGE) if MESSAGE in outputs else np.zeros((len(outputs[WEIGHTS]), 0))
    return LatentState(OnnxState(rounds, **outputs), message.astype(np.float32))
