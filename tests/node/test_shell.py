# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Variables of the shell that ROS cannot use are named, with their values, before ROS fails on them."""

import os
from pathlib import Path

import pytest

from magat_bringup.environment import loopback
from magat_node.shell import ShellError, check_shell


def shell(tmp_path: Path, **variables: str) -> dict[str, str]:
    return {"HOME": str(tmp_path), "AMENT_PREFIX_PATH": os.environ["AMENT_PREFIX_PATH"], **variables}


@pytest.mark.parametrize("domain", ["", "0", "101", "232"])
def test_a_shell_that_ros_can_use_is_accepted(tmp_path, domain):
    check_shell(shell(tmp_path, ROS_DOMAIN_ID=domain, RMW_IMPLEMENTATION="rmw_fastrtps_cpp"))
    check_shell(shell(tmp_path))
    check_shell(shell(tmp_path, **loopback(7)))
    check_shell(shell(tmp_path, ROS_SECURITY_ENABLE="true"))  # not enforced
    assert (tmp_path / ".ros" / "log").is_dir()


@pytest.mark.parametrize(
    ("variables", "said"),
    [
        ({"ROS_DOMAIN_ID": "abc"}, "ROS_DOMAIN_ID is 'abc': give a whole number from 0 to 232, or unset it"),
        ({"ROS_DOMAIN_ID": "500"}, "ROS_DOMAIN_ID is '500'"),
        ({"ROS_DOMAIN_ID": "-1"}, "ROS_DOMAIN_ID is '-1'"),
        ({"ROS_DOMAIN_ID": "1.5"}, "ROS_DOMAIN_ID is '1.5'"),
        ({"ROS_DOMAIN_ID": "²"}, "ROS_DOMAIN_ID is '²'"),
        (
            {"RMW_IMPLEMENTATION": "rmw_none_cpp"},
            "RMW_IMPLEMENTATION is 'rmw_none_cpp', which is not installed: choose rmw_fastrtps_cpp",
        ),
        ({"ROS_LOG_DIR": "/proc/logs"}, r"ROS cannot write its logs to /proc/logs \(No such file or directory\): set"),
        ({"ROS_LOG_DIR": "{tmp}/file/logs"}, "Not a directory"),
        ({"ROS_HOME": "{tmp}/file"}, "file/log .* set ROS_LOG_DIR"),
        ({"HOME": "/proc/nobody"}, "/proc/nobody/.ros/log"),
        (
            {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce"},
            "ROS_SECURITY_KEYSTORE is '', which is no keystore: make one by",
        ),
        (
            {
                "ROS_SECURITY_ENABLE": "true",
                "ROS_SECURITY_STRATEGY": "Enforce",
                "ROS_SECURITY_KEYSTORE": "{tmp}",
            },
            "which is no keystore",
        ),
    ],
)
def test_what_ros_cannot_use_is_refused(tmp_path, variables, said):
    (tmp_path / "file").write_text("")
    named = {name: value.replace("{tmp}", str(tmp_path)) for name, value in variables.items()}
    with pytest.raises(ShellError, match=said) as error:
        check_shell(shell(tmp_path, **named))
    assert "\n" not in str(error.value)
