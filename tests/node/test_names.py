# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Names of robots and namespaces: exactly those that ROS accepts."""

import pytest
import rclpy
from rclpy.signals import SignalHandlerOptions

from magat_node.names import LONGEST_NAME, LONGEST_NAMESPACE, InvalidNameError, check_robot_name, team_namespace

NAMES = [
    *("a", "A1", "_a", "a_", "a_b_c", "_", "__", "a__b", "__a", "a__", "3po", "a-b", "a b", "a.b", "é", ""),
    *("y", "Y", "n", "yes", "No", "on", "off", "true", "FALSE", "nan", "inf", "infinity", "on_", "null", "e5", "x1"),
]


def accepted(name: str) -> bool:
    try:
        check_robot_name(name)
    except InvalidNameError:
        return False
    return True


@pytest.mark.parametrize("name", NAMES)
def test_a_name_is_accepted_if_ros_takes_it_as_a_namespace_and_as_one_of_several_parameters(name):
    context = rclpy.Context()
    arguments = ["robot", "--ros-args", "-r", f"__ns:=/{name}", "-p", f"robots:=[{name},other]"]
    try:
        rclpy.init(args=arguments, context=context, signal_handler_options=SignalHandlerOptions.NO)
        node = rclpy.create_node("robot", context=context)
        ros_takes_it = node.get_namespace() == f"/{name}" and node.declare_parameter("robots", [""]).value[0] == name
        node.destroy_node()
    except (RuntimeError, rclpy.exceptions.InvalidNamespaceException):
        ros_takes_it = False
    finally:
        context.try_shutdown()
    # ROS takes the text between the brackets apart at blanks only if they are at its ends.
    assert accepted(name) == ros_takes_it


def test_a_name_is_not_too_long_for_the_topics_and_services_below_it():
    assert accepted("a" * LONGEST_NAME)
    assert not accepted("a" * (LONGEST_NAME + 1))
    longest = f"/{'n' * (LONGEST_NAMESPACE - 1)}"
    assert team_namespace(longest) == longest
    context = rclpy.Context()
    rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
    try:
        rclpy.create_node("robot", namespace=f"{longest}/{'a' * LONGEST_NAME}", context=context).destroy_node()
    finally:
        context.try_shutdown()


@pytest.mark.parametrize(("name", "said"), [(7, "put it in quotes"), ("red/r0", "without slashes"), (True, "not text")])
def test_what_is_no_name_says_why(name, said):
    with pytest.raises(InvalidNameError, match=said):
        check_robot_name(name)


@pytest.mark.parametrize(
    ("text", "namespace"), [("", ""), ("/", ""), ("red", "/red"), ("/red/", "/red"), ("hall/red", "/hall/red")]
)
def test_a_namespace_is_written_as_ros_does(text, namespace):
    assert team_namespace(text) == namespace


@pytest.mark.parametrize("text", ["red team", "a//b", "3", "a__b", "~", "a/{b}", "n" * 200])
def test_what_is_no_namespace_is_refused(text):
    with pytest.raises(InvalidNameError, match="the namespace"):
        team_namespace(text)
