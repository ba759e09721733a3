# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Log lines of a team's processes for one terminal, each prefixed with its coloured source."""

import re
import zlib

from rich.text import Text

#: As ROS prints it: ``[LEVEL] [seconds] [logger]: text``.
_ROS = re.compile(r"\[(?P<level>DEBUG|INFO|WARN|ERROR|FATAL)\] \[[\d.]+\] \[(?P<logger>[^\]]+)\]: (?P<text>.*)")
#: Distinguishable on light and dark terminals and for colour-blind readers. None of them marks a log level.
_COLOURS = ("blue", "cyan", "magenta", "bright_blue", "bright_cyan", "bright_magenta")
_LEVELS = {"WARN": "yellow", "ERROR": "bold red", "FATAL": "bold red"}


def styled(process: str, line: str, everything: bool = False) -> Text | None:
    """Format a log line.

    Args:
        process: that wrote it.
        line: as it was written.
        everything: whether lines below the level WARN are shown, too.

    Returns:
        The source (the node, or the process if the line is not in ROS's format) and the text; None if it is not shown.
    """
    match = _ROS.fullmatch(line)
    level = match["level"] if match else ""
    if not everything and level not in _LEVELS:
        return None
    source = match["logger"] if match else process
    colour = _COLOURS[zlib.crc32(source.encode()) % len(_COLOURS)]
    text = Text.assemble((f"{source} | ", colour))
    if level in _LEVELS:
        text.append(f"{level}: ", _LEVELS[level])
    return text.append(match["text"] if match else line)
