"""What a team's processes say, on one screen: who said it in front, in a colour of its own."""

import re
import zlib

from rich.text import Text

#: As ROS prints it: ``[LEVEL] [seconds] [logger]: text``.
_ROS = re.compile(r"\[(?P<level>DEBUG|INFO|WARN|ERROR|FATAL)\] \[[\d.]+\] \[(?P<logger>[^\]]+)\]: (?P<text>.*)")
#: Told apart on light and dark screens, with and without a sense for red and green. None is that of a level.
_COLOURS = ("blue", "cyan", "magenta", "bright_blue", "bright_cyan", "bright_magenta")
_LEVELS = {"WARN": "yellow", "ERROR": "bold red", "FATAL": "bold red"}


def styled(process: str, line: str, everything: bool = False) -> Text | None:
    """A line for people.

    Args:
        process: that said it.
        line: as it said it.
        everything: also what is no warning.

    Returns:
        The speaker (the node, or the process where the line is not ROS's) and what it said; None if to be left out.
    """
    said = _ROS.fullmatch(line)
    level = said["level"] if said else ""
    if not everything and level not in _LEVELS:
        return None
    speaker = said["logger"] if said else process
    colour = _COLOURS[zlib.crc32(speaker.encode()) % len(_COLOURS)]
    text = Text.assemble((f"{speaker} | ", colour))
    if level in _LEVELS:
        text.append(f"{level}: ", _LEVELS[level])
    return text.append(said["text"] if said else line)
