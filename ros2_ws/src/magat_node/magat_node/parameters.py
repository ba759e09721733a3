"""Read-only parameters with a description and a range."""

from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node


def declare_seconds(node: Node, name: str, default: float, meaning: str, at_least: float = 0.001) -> float:
    """Declare a time in seconds, from ``at_least`` to an hour, and return its value."""
    span = FloatingPointRange(from_value=at_least, to_value=3600.0)
    return _declare(node, name, default, ParameterDescriptor(description=meaning, floating_point_range=[span]))


def declare_share(node: Node, name: str, default: float, meaning: str) -> float:
    """Declare a share, from 0 to 1, and return its value."""
    span = FloatingPointRange(from_value=0.0, to_value=1.0)
    return _declare(node, name, default, ParameterDescriptor(description=meaning, floating_point_range=[span]))


def declare_count(node: Node, name: str, default: int, meaning: str, at_most: int, at_least: int = 1) -> int:
    """Declare a number from ``at_least`` to ``at_most`` and return its value."""
    span = IntegerRange(from_value=at_least, to_value=at_most)
    return _declare(node, name, default, ParameterDescriptor(description=meaning, integer_range=[span]))


def declare_value(node: Node, name: str, default: Any, meaning: str) -> Any:
    """Declare a parameter of the type of ``default`` and return its value."""
    return _declare(node, name, default, ParameterDescriptor(description=meaning))


def declare_choice(node: Node, name: str, default: str, choices: list[str], meaning: str) -> str:
    """Declare a parameter that is one of ``choices`` and return its value.

    Raises:
        ValueError: it is not one of them.
    """
    descriptor = ParameterDescriptor(description=meaning, additional_constraints=f"one of {choices}")
    value = _declare(node, name, default, descriptor)
    if value not in choices:
        raise ValueError(f"the parameter {name} is {value!r}: choose one of {choices}")
    return value


def _declare(node: Node, name: str, default: Any, descriptor: ParameterDescriptor) -> Any:
    descriptor.read_only = True
    return node.declare_parameter(name, default, descriptor).value
