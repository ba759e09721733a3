# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The configuration of a policy: its name in the paper, and the settings that the name leaves open."""

import re
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

from magat_node.errors import MagatError
from magat_robot.policy.grids import ACTIVATION_MAX, SUM_MAX
from magat_robot.policy.layers import LAYERS, LayerSpec

_NAME = re.compile(
    rf"(?P<layer>{'|'.join(LAYERS)})-(?P<type>[FB])-(?P<features>[0-9]{{1,9}})(-P(?P<heads>[0-9]{{1,9}}))?"
)

#: Shape of the field of view: channels for obstacles, robots and goal; 9 x 9 cells and a ring of one cell around them.
OBSERVATION_SHAPE = (3, 11, 11)
#: idle, up, down, left, right.
PRIMITIVES = 5
#: Limits of layer widths and of rounds, so that a damaged configuration cannot claim all memory.
MAX_SIZE = 4096
MAX_ROUNDS = 16
#: Upper limit of visit_memory, nats: one visit then counts more than any preference.
MAX_VISIT_MEMORY = 100.0
#: Shapes of the CNN, see `FeatureExtractor`.
CNNS = ("padded", "centred")
#: What computes a policy. onnx (onnxruntime) runs its exported form. torch is the reference: it computes the same bits,
#: for one robot several times slower and in more memory. echo computes nothing: it measures the cost of all else.
BACKENDS = ("onnx", "torch", "echo")
#: Encodings of messages (see `payload`), with their numbers in `magat_interfaces/msg/Feature`.
ENCODINGS = {"float32": 0, "float16": 1, "int8": 2}
#: Fields of a configuration that may be changed after training.
CHANGEABLE = ("temperature", "encoding", "visit_memory")
#: The encodings by number.
ENCODING_NAMES = {number: name for name, number in ENCODINGS.items()}


class ModelError(MagatError, ValueError):
    """A policy folder, name or configuration that cannot be used."""


@dataclass(frozen=True)
class PolicyConfig:
    """A validated configuration of a policy.

    Raises:
        ModelError: a value is out of range.
    """

    #: The paper's name, ``[MAGAT|GNN|GAT|GNN_baseline]-[F|B]-[Num_features]``, plus ``-P[heads]`` for several heads.
    name: str = "MAGAT-F-128"
    #: Channels of the CNN's three blocks.
    channels: tuple[int, int, int] = (32, 64, 128)
    #: Width of the action MLP's hidden layer.
    hidden: int = 128
    #: Taps K of a graph layer: it aggregates over K - 1 hops. With K = 1 robots send nothing.
    taps: int = 2
    #: Graph layers L.
    layers: int = 1
    #: Layers without attention: S is the adjacency divided by the receiver's degree if true, else the bare adjacency.
    normalise: bool = True
    #: Encoding of messages: float32, float16 or int8, see `payload`. A team may use another one than its policy's, as
    #: long as all robots use the same.
    encoding: str = "float32"
    #: Sampling temperature T: actions are drawn from softmax(logits / T).
    temperature: float = 1.0
    #: Shape of the CNN: "centred" takes a third of the CPU time of "padded". Configurations that do not name it have
    #: "padded". GNN_baseline has a CNN of its own and ignores this.
    cnn: str = "padded"
    #: What a robot subtracts from the log-probability of a move for each earlier visit of the cell that it leads to,
    #: nats (see `magat_robot.policy.visit_memory`); 0: robots do not remember their visits.
    visit_memory: float = 0.0

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise ModelError(f"unknown policy name {self.name!r}: use e.g. MAGAT-F-128, GNN-F-64 or MAGAT-B-32-P4")
        sizes = [*self.channels, self.hidden, self.features, self.heads, self.features * self.heads]
        if len(self.channels) != 3 or not all(1 <= size <= MAX_SIZE for size in sizes):
            raise ModelError(f"{self}: give three channels, and keep all sizes within 1 and {MAX_SIZE}")
        if self.cnn not in CNNS:
            raise ModelError(f"unknown CNN {self.cnn!r}: use one of {', '.join(CNNS)}")
        if self.taps < 1 or self.layers < 1 or self.layers * (self.taps - 1) > MAX_ROUNDS or self.layers > MAX_ROUNDS:
            raise ModelError(
                f"{self.layers} layers of {self.taps} taps: both must be at least 1; layers, and rounds of messages, "
                f"which are layers * (taps - 1), at most {MAX_ROUNDS}"
            )
        if max(self.message_sizes) > MAX_SIZE:
            raise ModelError(
                f"messages of {max(self.message_sizes)} numbers: the limit is {MAX_SIZE}; use fewer features or heads"
            )
        if self.encoding not in ENCODINGS:
            raise ModelError(f"unknown encoding {self.encoding!r}: use one of {', '.join(ENCODINGS)}")
        if not 0.01 <= self.temperature <= 100:
            raise ModelError(f"temperature {self.temperature} is not within 0.01 and 100")
        if not 0 <= self.visit_memory <= MAX_VISIT_MEMORY:
            raise ModelError(f"visit_memory {self.visit_memory} is not within 0 and {MAX_VISIT_MEMORY:g}")

    @property
    def layer(self) -> LayerSpec:
        """The kind of graph layer."""
        return LAYERS[str(self._part("layer"))]

    @property
    def communicates(self) -> bool:
        """Whether robots use each other's features: K > 1. With K = 1 they send one empty message a tick."""
        return self.taps > 1

    @property
    def message_sizes(self) -> tuple[int, ...]:
        """How many numbers a robot sends in each round of a tick.

        There are L (K - 1) rounds. In the first hop of a layer a message is the sender's x. In later hops it is the
        sender's aggregate of the hop before, head by head; with attention x is sent along, because receivers weigh
        each message by its contents alone. With K = 1 there is one round of empty messages.
        """
        sizes = []
        for layer in range(self.layers):
            inputs = self.features if layer == 0 else self.features * self.heads
            further = inputs * (1 + self.heads) if self.layer.attention else inputs
            sizes += [inputs, *[further] * (self.taps - 2)] if self.taps > 1 else []
        return tuple(sizes) or (0,)

    @property
    def largest(self) -> float:
        """The largest value that a message can hold."""
        sums = not self.layer.attention and not self.normalise and self.taps > 2
        return SUM_MAX if sums else ACTIVATION_MAX

    @property
    def bottleneck(self) -> bool:
        """Type B: the 128 features before the reduction also reach the action MLP."""
        return self._part("type") == "B"

    @property
    def features(self) -> int:
        """Num_features F: how many numbers a robot sends in the first round."""
        return int(self._part("features") or 0)

    @property
    def heads(self) -> int:
        """Number of attention heads, P."""
        return int(self._part("heads") or 1)

    def with_changes(self, **changes: Any) -> "PolicyConfig":
        """A copy with other values for fields that do not affect the weights: `CHANGEABLE`.

        Raises:
            ModelError: another field is given, or a value is out of range.
        """
        fixed = changes.keys() - set(CHANGEABLE)
        if fixed:
            raise ModelError(
                f"{', '.join(sorted(fixed))} cannot be changed after training: change one of {', '.join(CHANGEABLE)}"
            )
        return replace(self, **changes)

    def to_json(self) -> dict[str, Any]:
        """The configuration as plain JSON values."""
        return asdict(self) | {"channels": list(self.channels)}

    @classmethod
    def from_json(cls, values: Any) -> "PolicyConfig":
        """The configuration that `to_json` returned.

        Raises:
            ModelError: keys are unknown or missing, or values have the wrong type or are out of range.
        """
        known = {field.name for field in fields(cls)}
        if isinstance(values, dict):
            values = {"cnn": cls.cnn, "visit_memory": cls.visit_memory} | values  # older configurations lack these
        if not isinstance(values, dict) or set(values) != known:
            raise ModelError(f"policy configuration {values}: it must have exactly the keys {sorted(known)}")
        channels, sizes = values["channels"], [values[size] for size in ("hidden", "taps", "layers")]
        whole = isinstance(channels, list) and all(type(size) is int for size in [*channels, *sizes])
        texts = all(isinstance(values[text], str) for text in ("name", "cnn", "encoding"))
        numbers = all(type(values[number]) in (int, float) for number in ("temperature", "visit_memory"))
        if not (whole and texts and numbers and type(values["normalise"]) is bool):
            raise ModelError(
                f"unusable policy configuration {values}: sizes must be whole numbers; name, cnn and encoding "
                "strings; normalise true or false; temperature and visit_memory numbers"
            )
        return cls(**values | {"channels": tuple(channels)})

    def _part(self, group: str) -> str | None:
        match = _NAME.fullmatch(self.name)
        return match[group] if match else None
