# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Texts from the network cannot fill a log, or look like lines of others."""

from magat_bringup.log_lines import styled
from magat_node.text import log_line, shortened


def test_a_long_text_is_shortened_and_says_how_long_it_was():
    assert shortened("x" * 100_000) == "x" * 80 + "... (100000 characters)"
    assert shortened("short") == "short"


def test_a_text_stays_in_one_line():
    assert shortened("a\n[ERROR] [1.0] [simulator]: b\x1b[2J") == "a\\n[ERROR] [1.0] [simulator]: b\\x1b[2J"
    assert len(shortened("\n" * 1000)) < 120


def test_a_log_line_is_one_of_ros():
    assert str(styled("robots", log_line("WARN", "robots", "alice: killed"))) == "robots | WARN: alice: killed"
