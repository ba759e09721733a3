# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters: what they take, what they refuse and how, and which can be set while a node runs."""

from collections.abc import Callable, Iterator

import pytest
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from magat_node.parameters import (
    SettableParameters,
    declare_choice,
    declare_count,
    declare_seconds,
    declare_share,
    declare_value,
)


@pytest.fixture
def node() -> Iterator[Callable[..., Node]]:
    """Makes nodes that are given parameters."""
    context = rclpy.Context()
    rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
    made = []

    def make(**given: object) -> Node:
        overrides = [Parameter(name, value=value) for name, value in given.items()]
        made.append(rclpy.create_node("node", context=context, parameter_overrides=overrides))
        return made[-1]

    yield make
    for one in made:
        one.destroy_node()
    context.try_shutdown()


def test_a_whole_number_is_taken_for_a_time_and_for_a_share(node):
    one = node(patience=1, loss=1, cell=2)
    values = (
        declare_seconds(one, "patience", 0.5, ""),
        declare_share(one, "loss", 0.0, ""),
        declare_value(one, "cell", 1.0, ""),
    )
    assert values == (1.0, 1.0, 2.0)
    assert {one.get_parameter(name).type_ for name in ("patience", "loss", "cell")} == {Parameter.Type.DOUBLE}


@pytest.mark.parametrize(
    ("given", "declare", "said"),
    [
        ("abc", lambda n: declare_seconds(n, "p", 1.0, ""), "is 'abc': give a time in seconds, 0.001 to 3600"),
        (0, lambda n: declare_seconds(n, "p", 1.0, ""), "is 0.0: give a time in seconds"),
        (True, lambda n: declare_seconds(n, "p", 1.0, ""), "is True: give a time in seconds"),
        (1.5, lambda n: declare_share(n, "p", 0.0, ""), "is 1.5: give a share, 0 to 1"),
        (float("nan"), lambda n: declare_share(n, "p", 0.0, ""), "is nan: give a share"),
        (0, lambda n: declare_count(n, "p", 4, "", 64), "is 0: give a whole number, 1 to 64"),
        (2.0, lambda n: declare_count(n, "p", 4, "", 64), "is 2.0: give a whole number"),
        ("morse", lambda n: declare_choice(n, "p", "a", ["a", "b"], ""), r"is 'morse': choose one of \['a', 'b'\]"),
        (5, lambda n: declare_choice(n, "p", "a", ["a", "b"], ""), r"is 5: give one of \['a', 'b'\]"),
        (5, lambda n: declare_value(n, "p", ["a"], ""), "is 5: give a list of names"),
        (5, lambda n: declare_value(n, "p", "", ""), "is 5: give text"),
        ("on it", lambda n: declare_value(n, "p", True, ""), "is 'on it': give true or false"),
    ],
)
def test_a_value_that_cannot_be_says_what_could(node, given, declare, said):
    with pytest.raises(ValueError, match=f"the parameter p {said}"):
        declare(node(p=given))


def test_parameters_are_fixed_unless_they_are_settable(node):
    one = node()
    declare_seconds(one, "fixed", 1.0, "")
    declare_seconds(one, "deadline", 1.0, "", fixed=False)
    declare_count(one, "size", 0, "", 9, 0, fixed=False)
    why, applied = [""], []
    settable = SettableParameters(
        one, ["deadline"], lambda changes: why[0], lambda: applied.append(one.get_parameter("deadline").value)
    )

    def reason(name: str, value: object) -> str:
        (result,) = one.set_parameters([Parameter(name, value=value)])
        assert result.successful == (not result.reason)
        return result.reason

    assert "read-only" in reason("fixed", 2.0)
    assert reason("deadline", 2) == ""  # a whole number
    assert "Wrong parameter type" in reason("deadline", "soon")
    assert "out of range" in reason("deadline", 0.0)
    why[0] = "not now"
    assert reason("deadline", 3.0) == "not now"
    assert applied == [2.0]
    settable.show("size", 4)
    assert one.get_parameter("size").value == 4
    assert reason("size", 5) == "size: fixed while the node runs"
    assert reason("use_sim_time", False) == ""
