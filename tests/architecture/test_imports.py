# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""The packages depend on each other one way, as their manifests say, and none is too large.

All of this is computed from the sources, which are not imported. Imports in functions and under TYPE_CHECKING count.
"""

import ast
import re
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

SOURCES = Path(__file__).resolve().parents[2] / "ros2_ws" / "src"

#: Every package may import those before it. A new package goes where its imports allow it.
ORDER = (
    "magat_interfaces",
    "magat_node",
    "magat_expert",
    "magat_robot",
    "magat_sim",
    "magat_pictures",
    "magat_evaluation",
    "magat_recording",
    "magat_training",
    "magat_viewer",
    "magat_bringup",
    "magat_bench",
    "magat_cli",
)
#: No package may have a larger share of all lines.
LARGEST_SHARE = 0.20
CODE = (".py", ".cpp", ".hpp", ".js", ".css", ".html")

#: rosdep's keys of libraries that are not ROS packages.
ROSDEP_KEYS = {
    "PIL": "python3-pil",
    "aiohttp": "python3-aiohttp",
    "matplotlib": "python3-matplotlib",
    "numpy": "python3-numpy",
    "pandas": "python3-pandas",
    "psutil": "python3-psutil",
    "rich": "python3-rich",
    "scipy": "python3-scipy",
    "yaml": "python3-yaml",
}
#: Libraries for which rosdep has no package of the system, or too old a one; the files requirements-*.txt have them.
FROM_PIP = {
    "distributed",
    "mcap",
    "mcap_ros2",
    "onnx",
    "onnxruntime",
    "onnxscript",
    "playwright",
    "pogema",  # by requirements-pogema.txt
    "safetensors",
    "tensorboardX",
    "torch",
    "zstandard",
}
#: Not in any manifest: robots have no screen, and only team.launch.py with rviz:=true starts it.
OPTIONAL = {"rviz2"}


@cache
def modules() -> dict[str, Path]:
    """Each module's name, such as "magat_sim.grid", and its file; launch files and scripts, too."""
    found = {}
    for package in ORDER:
        folder = SOURCES / package
        for path in (*folder.glob(f"{package}/**/*.py"), *folder.glob(f"{package}/**/*.pyi")):
            parts = path.relative_to(folder).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
        for path in (*folder.glob("launch/*.py"), *folder.glob("scripts/*")):
            found[f"{package}:{path.name}"] = path
    return found


def package_of(module: str) -> str:
    """The package of a module, or the library's top name."""
    return module.replace(":", ".").partition(".")[0]


def imports_of(module: str, path: Path) -> Iterator[str]:
    """The full name of everything that a module imports; of names in a module, the module's."""
    for node in ast.walk(ast.parse(path.read_text(), str(path))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}:{node.lineno}: import by the full name, not relative to the module"
            assert node.module is not None
            for alias in node.names:
                submodule = f"{node.module}.{alias.name}"
                yield submodule if submodule in modules() else node.module


@cache
def graph() -> dict[str, frozenset[str]]:
    """What each module imports."""
    return {module: frozenset(imports_of(module, path)) - {module} for module, path in modules().items()}


@cache
def package_graph() -> dict[str, frozenset[str]]:
    """The packages of this workspace that each of them imports."""
    found: dict[str, set[str]] = {package: set() for package in ORDER}
    for module, imported in graph().items():
        found[package_of(module)] |= {package_of(other) for other in imported} & set(ORDER)
    return {package: frozenset(imported - {package}) for package, imported in found.items()}


@cache
def lines() -> dict[str, int]:
    """Lines of code of each package."""
    counts = dict.fromkeys(ORDER, 0)
    for package in ORDER:
        files = [path for path in (SOURCES / package).rglob("*") if path.suffix in CODE]
        counts[package] = sum(len(path.read_text().splitlines()) for path in files)
    return counts


def table() -> str:
    """Each package with its lines of code and its imports, from the bottom up."""
    total = sum(lines().values())
    rows = [f"{'package':18} {'lines':>6} {'share':>6}  imports"]
    for package in ORDER:
        imported = " ".join(other.removeprefix("magat_") for other in ORDER if other in package_graph()[package])
        rows.append(f"{package:18} {lines()[package]:6} {lines()[package] / total:6.1%}  {imported}")
    return "\n".join(["", *rows])


def circle(arrows: dict[str, frozenset[str]]) -> list[str]:
    """A circle in a graph, or nothing."""
    try:
        TopologicalSorter(arrows).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def started_programs(path: Path) -> set[str]:
    """The packages whose programs a file starts: what it passes as ``package=`` to describe a process."""
    calls = [node for node in ast.walk(ast.parse(path.read_text(), str(path))) if isinstance(node, ast.Call)]
    values = [keyword.value for call in calls for keyword in call.keywords if keyword.arg == "package"]
    return {value.value for value in values if isinstance(value, ast.Constant) and isinstance(value.value, str)}


def message_packages(path: Path) -> set[str]:
    """The packages of the messages that a file names in texts, such as "std_msgs/msg/Empty"."""
    texts = [node.value for node in ast.walk(ast.parse(path.read_text(), str(path))) if isinstance(node, ast.Constant)]
    found = (re.match(r"(\w+)/(?:msg|srv|action)/", text) for text in texts if isinstance(text, str))
    return {match[1] for match in found if match}


def test_every_package_has_its_place() -> None:
    assert {path.parent.name for path in SOURCES.glob("*/package.xml")} == set(ORDER), "mend ORDER in this file"


def test_no_circle_between_modules() -> None:
    found = circle(graph())
    assert not found, f"a circle of imports: {' -> '.join(found)}{table()}"


def test_no_circle_between_packages() -> None:
    found = circle(package_graph())
    assert not found, f"a circle of packages: {' -> '.join(found)}{table()}"


def test_no_package_imports_one_above_it() -> None:
    found = [
        f"{module} imports {other}"
        for module, imported in graph().items()
        for other in sorted(imported)
        if package_of(other) in ORDER and ORDER.index(package_of(other)) > ORDER.index(package_of(module))
    ]
    assert not found, "\n".join([*found, table()])


def test_no_package_is_too_large() -> None:
    total = sum(lines().values())
    too_large = [package for package, count in lines().items() if count > LARGEST_SHARE * total]
    assert not too_large, f"more than {LARGEST_SHARE:.0%} of the lines: {', '.join(too_large)}{table()}"


@pytest.mark.parametrize("package", [name for name in ORDER if name != "magat_interfaces"])
def test_a_manifest_names_what_the_package_needs(package: str) -> None:
    """``exec_depend`` are the packages that it imports, whose programs it starts, or whose messages it names."""
    own = {module: path for module, path in modules().items() if package_of(module) == package}
    libraries = {package_of(other) for module in own for other in graph()[module]} - set(sys.stdlib_module_names)
    named = set().union(*(started_programs(path) | message_packages(path) for path in own.values()))
    needed = {ROSDEP_KEYS.get(name, name) for name in (libraries | named) - FROM_PIP - OPTIONAL} - {package}
    manifest = ET.parse(SOURCES / package / "package.xml").getroot()
    declared = {element.text for tag in ("depend", "exec_depend") for element in manifest.iter(tag)}
    missing, needless = sorted(needed - declared), sorted(declared - needed)
    assert not missing, f"package.xml of {package} lacks <exec_depend> of {', '.join(missing)}"
    assert not needless, f"package.xml of {package} names, but nothing imports: {', '.join(needless)}"
