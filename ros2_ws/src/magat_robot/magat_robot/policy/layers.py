# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The registry of graph layers: the names that a policy's name may begin with, and the properties of each layer.

A layer is registered where it is defined, by the decorator `magat_robot.policy.graph.layer`::

    @layer("MAGAT")
    class MessageAwareAttention(GraphLayer): ...

This module reads the arguments of the decorators from the source of `graph.py` and does not import it. Importing it
would import torch, which takes a second and hundreds of megabytes; the ``magat`` command and robots with the onnx
backend need the names only.
"""

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

#: Name of the decorator in `graph.py`.
_DECORATOR = "layer"


@dataclass(frozen=True)
class LayerSpec:
    """Properties of a graph layer that a configuration depends on: the arguments of its ``@layer(...)``."""

    #: First part of the names of its policies.
    name: str
    #: The layer weights messages by their contents. For this, a message repeats the sender's x from the second hop on.
    #: A layer without attention weights all messages equally: S is the adjacency, divided by the receiver's degree if
    #: `PolicyConfig.normalise` is true.
    attention: bool = True
    #: The CNN is a plain stack, without residual blocks.
    plain_cnn: bool = False


def _registered(source: str) -> Mapping[str, LayerSpec]:
    """The layers that the classes in ``source`` (Python) are decorated as, by name."""
    classes = (node for node in ast.parse(source).body if isinstance(node, ast.ClassDef))
    calls = (call for node in classes for call in node.decorator_list if isinstance(call, ast.Call))
    specs: dict[str, LayerSpec] = {}
    for call in calls:
        if isinstance(call.func, ast.Name) and call.func.id == _DECORATOR:
            (name,) = (ast.literal_eval(value) for value in call.args)
            options = {option.arg: ast.literal_eval(option.value) for option in call.keywords if option.arg}
            specs[name] = LayerSpec(name, **options)
    return MappingProxyType(specs)


#: The registered layers by name, in the order of their definition.
LAYERS = _registered(Path(__file__).with_name("graph.py").read_text())
