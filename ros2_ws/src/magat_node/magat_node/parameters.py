# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters with a description and a range; those that can be set while a node runs, and those that cannot."""

from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

#: What values are called in messages.
_KINDS = {bool: "true or false", float: "a number", int: "a whole number", str: "text", list: "a list of names"}


def declare_seconds(
    node: Node, name: str, default: float, meaning: str, at_least: float = 0.001, fixed: bool = True
) -> float:
    """Declare a time in seconds, from ``at_least`` to an hour, and return its value.

    This and the other functions raise a ValueError if the node is given another value.

    Args:
        node: that has the parameter.
        name: of the parameter.
        default: its value if the node is given none.
        meaning: its description.
        at_least: the shortest time.
        fixed: whether it cannot be set while the node runs. Otherwise see `SettableParameters`.
    """
    span = FloatingPointRange(from_value=at_least, to_value=3600.0)
    descriptor = ParameterDescriptor(description=meaning, floating_point_range=[span], read_only=fixed)
    return _declare(node, name, default, descriptor, f"a time in seconds, {at_least:g} to {span.to_value:g}")


def declare_share(node: Node, name: str, default: float, meaning: str, fixed: bool = True) -> float:
    """Declare a share, from 0 to 1, and return its value."""
    span = FloatingPointRange(from_value=0.0, to_value=1.0)
    descriptor = ParameterDescriptor(description=meaning, floating_point_range=[span], read_only=fixed)
    return _declare(node, name, default, descriptor, "a share, 0 to 1")


def declare_count(
    node: Node, name: str, default: int, meaning: str, at_most: int, at_least: int = 1, fixed: bool = True
) -> int:
    """Declare a number from ``at_least`` to ``at_most`` and return its value."""
    span = IntegerRange(from_value=at_least, to_value=at_most)
    descriptor = ParameterDescriptor(description=meaning, integer_range=[span], read_only=fixed)
    return _declare(node, name, default, descriptor, f"a whole number, {at_least} to {at_most}")


def declare_value(node: Node, name: str, default: Any, meaning: str, fixed: bool = True) -> Any:
    """Declare a parameter of the type of ``default`` and return its value."""
    descriptor = ParameterDescriptor(description=meaning, read_only=fixed)
    return _declare(node, name, default, descriptor, _KINDS[type(default)])


def declare_choice(node: Node, name: str, default: str, choices: list[str], meaning: str, fixed: bool = True) -> str:
    """Declare a parameter that is one of ``choices`` and return its value."""
    descriptor = ParameterDescriptor(description=meaning, additional_constraints=f"one of {choices}", read_only=fixed)
    value = _declare(node, name, default, descriptor, f"one of {choices}")
    if value not in choices:
        raise ValueError(f"the parameter {name} is {value!r}: choose one of {choices}")
    return value


def _declare(node: Node, name: str, default: Any, descriptor: ParameterDescriptor, wanted: str) -> Any:
    # What is given is read first, whatever its type, so that a whole number can be a time.
    given = node.declare_parameter(name, default, ParameterDescriptor(dynamic_typing=True))
    node.undeclare_parameter(name)
    given = _as_number(given) if isinstance(default, float) else given
    problem = ValueError(f"the parameter {name} is {given.value!r}: give {wanted}")
    if given.type_ is not Parameter.Type.from_parameter_value(default):
        raise problem
    try:
        return node.declare_parameter(name, given.value, descriptor, ignore_override=True).value
    except InvalidParameterValueException:
        raise problem from None


def _as_number(parameter: Parameter) -> Parameter:
    """A whole number as a parameter that is not a whole number; any other parameter as it is."""
    if parameter.type_ is not Parameter.Type.INTEGER:
        return parameter
    return Parameter(parameter.name, value=float(parameter.value))


class SettableParameters:
    """The parameters of a node that can be set while it runs.

    Whole numbers are taken where numbers are expected.
    """

    def __init__(
        self, node: Node, names: list[str], refuse: Callable[[dict[str, Any]], str], apply: Callable[[], None]
    ) -> None:
        """Watch the parameters of ``node``; to be called when all have been declared.

        Args:
            node: that has the parameters.
            names: of those that can be set; they are declared with ``fixed=False``.
            refuse: returns why the new values, by name, cannot be set; an empty text if they can.
            apply: called after new values have been set.
        """
        self._node, self._names, self._refuse, self._apply = node, names, refuse, apply
        self._shown: set[str] = set()
        self._showing = False
        node.add_pre_set_parameters_callback(self._convert)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._set)

    def show(self, name: str, value: Any) -> None:
        """Let a parameter, declared with ``fixed=False``, show the value that it stands for, and fix it."""
        self._shown.add(name)
        self._showing = True
        try:
            self._node.set_parameters([Parameter(name, value=value)])
        finally:
            self._showing = False

    def _convert(self, parameters: list[Parameter]) -> list[Parameter]:
        return [
            _as_number(parameter)
            if self._node.has_parameter(parameter.name)
            and self._node.get_parameter(parameter.name).type_ is Parameter.Type.DOUBLE
            else parameter
            for parameter in parameters
        ]

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        fixed = [parameter.name for parameter in parameters if parameter.name in self._shown]
        changes = {parameter.name: parameter.value for parameter in parameters if parameter.name in self._names}
        if self._showing:
            reason = ""
        elif fixed:
            reason = f"{', '.join(fixed)}: fixed while the node runs"
        else:
            reason = self._refuse(changes) if changes else ""
        return SetParametersResult(successful=not reason, reason=reason)

    def _set(self, parameters: list[Parameter]) -> None:
        if any(parameter.name in self._names for parameter in parameters):
            self._apply()
