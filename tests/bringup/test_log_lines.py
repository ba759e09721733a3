# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a team's processes say, as it is shown."""

import pytest

from magat_bringup.log_lines import styled


@pytest.mark.parametrize(
    ("process", "line", "shown"),
    [
        (
            "robots",
            "[WARN] [1790000000.123456789] [alice.robot]: all is not well",
            "alice.robot | WARN: all is not well",
        ),
        ("robots", "[FATAL] [1.5] [robot]: no [such] policy: a [b]", "robot | FATAL: no [such] policy: a [b]"),
        ("simulator", "[ERROR] [1.5] [simulator]: ", "simulator | ERROR: "),
        ("simulator", "[INFO] [1.5] [simulator]: robot_1 is back", None),
        ("robots", "robot_0 137 and is started again", None),
    ],
)
def test_warnings_are_shown_with_who_said_them(process, line, shown):
    text = styled(process, line)
    assert (text.plain if text else None) == shown


def test_everything_is_shown_if_wanted():
    assert styled("simulator", "[INFO] [1.5] [simulator]: robot_1 is back", True).plain == "simulator | robot_1 is back"
    assert styled("robots", "Traceback (most recent call last):", True).plain.startswith("robots | Traceback")


def test_a_speaker_has_one_colour_and_levels_have_others():
    def colours(line):
        return [str(span.style) for span in styled("robots", line, True).spans]

    speakers = {colours(f"[INFO] [1.5] [robot_{i}.robot]: hello")[0] for i in range(30)}
    assert len(speakers) > 3
    assert colours("[INFO] [1.5] [a]: x") == colours("[INFO] [2.5] [a]: y")
    assert colours("[WARN] [1.5] [a]: x")[1] == "yellow"
    assert colours("[ERROR] [1.5] [a]: x")[1] == "bold red"
    assert not speakers & {"yellow", "bold red"}
