# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Exports a policy to ONNX, for the backend onnx (`onnx_policy`).

Each step of a tick becomes a file: one for `PolicyNetwork.perceive`, one for each round of `PolicyNetwork.hear`.
"""

import hashlib
import json
import logging
import shutil
import warnings
from pathlib import Path

import torch
from torch import Tensor, nn

from magat_robot.policy import fixed_point as fp
from magat_robot.policy.config import OBSERVATION_SHAPE
from magat_robot.policy.folder import CONTENTS, EXPORT, EXPORT_VERSION, part_names
from magat_robot.policy.network import NodeState, PolicyNetwork, to_fixed_point
from magat_robot.policy.onnx_policy import (
    ATTENTION,
    FIELD_OF_VIEW,
    MESSAGE,
    MESSAGES,
    OUTPUT,
    PRESENT,
    TEMPERATURE,
    WEIGHTS,
)
from magat_robot.policy.store import load_network

#: Robots, and places for messages, in the examples that are traced; both are dynamic in the exported parts.
_ROBOTS, _PLACES = 3, 2


def export(folder: Path) -> Path:
    """Export the policy in ``folder`` to its subfolder ``onnx``; returns the subfolder.

    Raises:
        ModelError: as `load_network`.
    """
    trained, digest = load_network(folder)
    network = to_fixed_point(trained)
    fp.exp_weights(torch.zeros(1, 1, dtype=torch.float64))  # creates its table, which is not to be traced
    draft = folder / f"{EXPORT}.draft"
    shutil.rmtree(draft, ignore_errors=True)
    draft.mkdir()
    field_of_view = torch.zeros(_ROBOTS, *OBSERVATION_SHAPE)
    temperature = {TEMPERATURE: torch.tensor(1.0, dtype=torch.float64)}
    names = part_names(network.rounds)
    part: _Part = _Perceive(network)
    inputs, state = {FIELD_OF_VIEW: field_of_view}, network.perceive(field_of_view)
    for number, name in enumerate(names):
        if number > 0:
            message = network.message(state)
            heard = {
                MESSAGES: message[:, None].expand(-1, _PLACES, -1).contiguous(),
                PRESENT: torch.ones(_ROBOTS, _PLACES, dtype=torch.bool),
            }
            part = _Hear(network, number - 1, list(_fields(state)))
            inputs, state = _fields(state) | heard, network.hear(state, *heard.values())
        attention = [ATTENTION] if number > 0 and network.config.communicates else []
        if state.rounds == network.rounds:
            _write(draft / name, part, inputs | temperature, [WEIGHTS, *attention])
        else:
            _write(draft / name, part, inputs, [*_fields(state), MESSAGE, *attention])
    files = {name: hashlib.sha256((draft / name).read_bytes()).hexdigest() for name in names}
    contents = {"version": EXPORT_VERSION, "weights": digest, "files": files}
    (draft / CONTENTS).write_text(json.dumps(contents, indent=2) + "\n")
    shutil.rmtree(folder / EXPORT, ignore_errors=True)
    draft.rename(folder / EXPORT)
    return folder / EXPORT


def _fields(state: NodeState) -> dict[str, Tensor]:
    """The tensors of ``state`` by name."""
    fields = {"features": state.features, "x": state.x, "total": state.total}
    return fields if state.aggregated is None else fields | {"aggregated": state.aggregated}


class _Part(nn.Module):
    """A step of a tick as a module from tensors to tensors, which can be traced."""

    def __init__(self, network: PolicyNetwork) -> None:
        super().__init__()
        self.network = network

    def outputs(self, state: NodeState, temperature: Tensor | None) -> tuple[Tensor, ...]:
        if temperature is not None:
            exponents = fp.snap(self.network.logits(state) / temperature, fp.EXPONENT_BITS, -1e6, 1e6)
            return (fp.exp_weights(exponents),)
        # Copies, because an output that is also an input, or another output, loses its name.
        return tuple(tensor.clone() for tensor in (*_fields(state).values(), self.network.message(state)))


class _Perceive(_Part):
    def forward(self, field_of_view: Tensor, temperature: Tensor | None = None) -> tuple[Tensor, ...]:
        return self.outputs(self.network.perceive(field_of_view), temperature)


class _Hear(_Part):
    def __init__(self, network: PolicyNetwork, rounds: int, names: list[str]) -> None:
        super().__init__(network)
        self.rounds, self.names = rounds, names

    def forward(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        fields, (messages, present, *temperature) = inputs[: len(self.names)], inputs[len(self.names) :]
        known = dict(zip(self.names, fields, strict=True))
        state = NodeState(known["features"], self.rounds, known["x"], known.get("aggregated"), known["total"])
        outputs = self.outputs(self.network.hear(state, messages, present), temperature[0] if temperature else None)
        if not self.network.config.communicates:
            return outputs
        return *outputs, self.network.attention(state, messages, present)


def _write(path: Path, part: _Part, inputs: dict[str, Tensor], outputs: list[str]) -> None:
    robots, places = torch.export.Dim("robots", min=1, max=65_536), torch.export.Dim("places", min=1, max=65_536)
    shapes = []
    for name, value in inputs.items():
        dynamic = {0: robots} if value.dim() else {}
        shapes.append(dynamic | ({1: places} if name in (MESSAGES, PRESENT) else {}))
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # it warns of missing packages that are not needed
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        program = torch.onnx.export(
            part.eval(),
            tuple(inputs.values()),
            input_names=list(inputs),
            output_names=[OUTPUT + name for name in outputs],
            dynamic_shapes=(tuple(shapes),) if isinstance(part, _Hear) else tuple(shapes),
            dynamo=True,
            verbose=False,
        )
    assert program is not None
    model = program.model_proto
    for described in (model, model.graph, *model.graph.node, *model.graph.value_info):
        del described.metadata_props[:]  # traces of this machine's files
    path.write_bytes(model.SerializeToString(deterministic=True))
