"""What a policy is: the paper's name of it, and every number that the name leaves open."""

import re
from dataclasses import asdict, dataclass, fields
from typing import Any

_NAME = re.compile(r"MAGAT-(?P<type>[FB])-(?P<features>\d+)(-P(?P<heads>\d+))?")

#: No layer is wider; a damaged configuration must not claim all memory.
MAX_SIZE = 4096


class ModelError(ValueError):
    """A policy folder, name or configuration that cannot be used; the message says why and what to do."""


@dataclass(frozen=True)
class PolicyConfig:
    """Configuration of a policy, checked when it is made.

    Raises:
        ModelError: a value is out of range.
    """

    #: The paper's name, ``MAGAT-[F|B]-[Num_features]`` and ``-P[heads]`` for more than one head.
    name: str = "MAGAT-F-128"
    #: Channels of the three residual blocks.
    channels: tuple[int, int, int] = (32, 64, 128)
    #: Width of the action MLP's hidden layer.
    hidden: int = 128
    #: Sampling temperature T: actions are drawn from softmax(logits / T).
    temperature: float = 1.0

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise ModelError(f"unknown policy name {self.name!r}: use e.g. MAGAT-F-128, MAGAT-B-32 or MAGAT-B-32-P4")
        sizes = [*self.channels, self.hidden, self.features, self.heads, self.features * self.heads]
        if len(self.channels) != 3 or not all(1 <= size <= MAX_SIZE for size in sizes):
            raise ModelError(f"there are three channels, and sizes lie within 1 and {MAX_SIZE}: {self}")
        if not 0.01 <= self.temperature <= 100:
            raise ModelError(f"temperature {self.temperature} is not within 0.01 and 100")

    @property
    def bottleneck(self) -> bool:
        """Type B: the 128 features before the reduction also reach the action MLP."""
        return self._part("type") == "B"

    @property
    def features(self) -> int:
        """Num_features F: how many numbers a robot sends to its neighbours."""
        return int(self._part("features") or 0)

    @property
    def heads(self) -> int:
        """Number of attention heads, P."""
        return int(self._part("heads") or 1)

    def to_json(self) -> dict[str, Any]:
        """The configuration as plain JSON values."""
        return asdict(self)

    @classmethod
    def from_json(cls, values: Any) -> "PolicyConfig":
        """The configuration that `to_json` wrote.

        Raises:
            ModelError: unknown or missing keys, or values of the wrong kind.
        """
        known = {field.name for field in fields(cls)}
        if not isinstance(values, dict) or set(values) != known:
            raise ModelError(f"a policy configuration has exactly the keys {sorted(known)}; this one: {values}")
        name, channels, hidden = values["name"], values["channels"], values["hidden"]
        whole = isinstance(channels, list) and all(type(size) is int for size in [*channels, hidden])
        if not (isinstance(name, str) and whole and type(values["temperature"]) in (int, float)):
            raise ModelError(f"unusable policy configuration {values}: sizes are whole numbers, the name is a text")
        return cls(name, tuple(channels), hidden, float(values["temperature"]))

    def _part(self, group: str) -> str | None:
        match = _NAME.fullmatch(self.name)
        return match[group] if match else None
