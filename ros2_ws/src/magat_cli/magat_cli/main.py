# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The ``magat`` command: finds the verb, reads its options, runs it, and prints errors in one line."""

import argparse
import importlib
import os
import pkgutil
import sys
from io import TextIOWrapper
from pathlib import Path
from types import ModuleType

from magat_node.imports import quiet_imports

with quiet_imports():
    from magat_cli import verb as verbs
    from magat_cli.options import Options, read_options
    from magat_node.errors import MagatError

#: Exit status of a process that Ctrl-C ended.
INTERRUPTED = 130


def main(args: list[str] | None = None) -> int:
    """Run the command line ``args`` (that of the process if None); returns the exit status."""
    _print_any_text()
    with quiet_imports():
        verb, options, args = _read(sys.argv[1:] if args is None else args)
    return 0 if verb is None else _run(verb, options, args)


def _print_any_text() -> None:
    """Print ? for characters that the encoding of the terminal lacks, instead of failing."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")


def _read(args: list[str]) -> tuple[ModuleType | None, Options, list[str]]:
    """The verb of a command line, its options, and the command line; no verb if the list of verbs was printed."""
    modules = {name.replace("_", "-"): name for _, name, _ in pkgutil.iter_modules(verbs.__path__)}
    if not args or args[0] not in modules:
        _top_level(modules, args)
        return None, Options(), args
    verb = _load(modules[args[0]])
    parser = argparse.ArgumentParser(prog=f"magat {args[0]}", description=verb.__doc__)
    verb.add_arguments(parser)
    return verb, read_options(parser, args[1:]), args


def _load(name: str) -> ModuleType:
    return importlib.import_module(f"{verbs.__name__}.{name}")


def _top_level(modules: dict[str, str], args: list[str]) -> None:
    """Print the list of verbs, or what is wrong with ``args``; exits as argparse does."""
    parser = argparse.ArgumentParser(
        prog="magat", description="Learned, decentralised multi-robot path planning on ROS 2."
    )
    listed = parser.add_subparsers(metavar="VERB", required=True, title="verbs")
    for verb, name in modules.items():
        listed.add_parser(verb, help=(_load(name).__doc__ or "").partition("\n")[0])
    parser.parse_args(args)


def _run(verb: ModuleType, options: Options, args: list[str]) -> int:
    with quiet_imports():
        from rich.console import Console
        from rich.markup import escape

        from magat_node import interruption

    interruption.watch()
    console = Console(stderr=True)  # standard output is for results
    try:
        if getattr(verb, "NEEDS_ROS", False):
            _source_workspace(args)
        return verb.main(options, console)
    except KeyboardInterrupt as interrupt:
        console.print(f"interrupted: {str(interrupt) or 'every process has ended'}")
        return INTERRUPTED
    except MagatError as error:
        console.print(f"[bold red]magat:[/] {escape(str(error))}", highlight=False, soft_wrap=True)
        return 1
    except OSError as error:
        if error.filename is None:  # it is not about a file that the user chose
            raise
        console.print(f"[bold red]magat:[/] {escape(_about_file(error))}", highlight=False, soft_wrap=True)
        return 1


def _about_file(error: OSError) -> str:
    """One line about a file that cannot be read or written."""
    where = " and ".join(str(name) for name in (error.filename, error.filename2) if name is not None)
    return f"{where}: {error.strerror}: give another file or folder, or mend this one"


def _source_workspace(args: list[str]) -> None:
    """Start again with the workspace sourced, unless it is.

    Raises:
        MagatError: the workspace is not built.
    """
    prefixes = [Path(prefix) for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)]
    if any((prefix / "share" / "magat_interfaces").is_dir() for prefix in prefixes):
        return
    here = Path(__file__).resolve()
    scripts = [place / name for place in here.parents for name in ("setup.bash", "install/setup.bash")]
    script = next((script for script in scripts if script.is_file()), None)
    if script is None:
        raise MagatError("this needs ROS and the built workspace: run `make setup`, or source install/setup.bash")
    program = f'source "$0" && exec "{sys.executable}" -m magat_cli "$@"'
    os.execvp("bash", ["bash", "-c", program, str(script), *args])
