"""A policy computed by onnxruntime: the same bits as torch's, several times faster for one robot, without torch.

`magat_robot.policy.export` writes what is read here. Exact sums have no order (see `fixed_point`), so another library's
order of computing changes nothing.
"""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import onnxruntime

from magat_robot.policy.config import OBSERVATION_SHAPE, ModelError
from magat_robot.policy.folder import EXPORT, read_folder
from magat_robot.policy.interface import Decision, LatentState
from magat_robot.policy.sampling import choose, uniform

#: Table of contents of the exported policy.
CONTENTS = "contents.json"
#: What a session takes and gives besides the state.
VIEW, MESSAGE, MESSAGES, PRESENT, TEMPERATURE, RESULT = (
    "view",
    "message",
    "messages",
    "present",
    "temperature",
    "weights",
)

#: Before the names of what a session gives: a graph has each name once.
GIVEN = "given_"


def part_names(rounds: int) -> list[str]:
    """The files of an exported policy, in the order in which they are run in a tick; the last one weighs, too."""
    return ["look.onnx", *(f"hear_{number}.onnx" for number in range(rounds))]


class _Session:
    """A part of the policy that has been loaded: from values by name, of which it takes what it wants, to others."""

    def __init__(self, data: bytes, options: onnxruntime.SessionOptions) -> None:
        self._session = onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
        self._wanted = [wanted.name for wanted in self._session.get_inputs()]
        self._given = [given.name.removeprefix(GIVEN) for given in self._session.get_outputs()]

    def __call__(self, values: dict[str, Any]) -> dict[str, Any]:
        results = self._session.run(None, {name: values[name] for name in self._wanted})
        return dict(zip(self._given, results, strict=True))


class OnnxPolicy:
    """The exported policy in a folder, a `RobotPolicy`."""

    def __init__(self, folder: Path, threads: int = 1, **changes: Any) -> None:
        """Load it.

        Args:
            folder: of the policy; it has been exported.
            threads: of each computation.
            changes: fields of its configuration that are a matter of its deployment: temperature, encoding.

        Raises:
            ModelError: it has not been exported, or is damaged, or was exported from other weights.
        """
        config, self.digest, _ = read_folder(folder)
        self.config = config.deployed(**changes)
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
        parts = _read_export(folder, self.digest, part_names(len(config.message_sizes)))
        try:
            self._parts = [_Session(data, options) for data in parts]
        except Exception as error:  # its own, which have nothing else in common
            raise ModelError(f"onnxruntime cannot load {folder / EXPORT}: {error}") from error
        self._temperature = np.array(self.config.temperature)

    def perceive(self, view: npt.NDArray[np.uint8]) -> LatentState:
        """See `RobotPolicy.perceive`."""
        if view.shape[1:] != OBSERVATION_SHAPE:
            raise ValueError(f"an observation has shape {OBSERVATION_SHAPE}, not {view.shape[1:]}")
        if view.size and view.max() > 1:
            raise ValueError(f"an observation holds 0 and 1, not {view.max()}")
        return self._next(0, {VIEW: view.astype(np.float32)})

    def hear(self, own: LatentState, messages: npt.NDArray[np.float32], present: npt.NDArray[np.bool_]) -> LatentState:
        """See `RobotPolicy.hear`."""
        if messages.shape[1] == 0:  # an empty place more changes nothing, and spares the operators an empty dimension
            messages, present = np.pad(messages, ((0, 0), (0, 1), (0, 0))), np.pad(present, ((0, 0), (0, 1)))
        heard = np.where(present[:, :, None], messages, np.float32(0)).astype(np.float64)
        return self._next(own.state["part"], own.state | {MESSAGES: heard, PRESENT: present})

    def decide(self, own: LatentState, streams: npt.NDArray[np.uint64], tick: int) -> Decision:
        """See `RobotPolicy.decide`."""
        weights = own.state[RESULT]
        return Decision(weights, choose(weights, uniform(streams, tick)))

    def _next(self, part: int, values: dict[str, Any]) -> LatentState:
        state = self._parts[part](values | {TEMPERATURE: self._temperature})
        # The last part weighs, and there is nothing to send any more.
        message = state.pop(MESSAGE) if MESSAGE in state else np.zeros((len(state[RESULT]), 0))
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
