# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""How quickly the command starts, and what each verb may import."""

import ast
import os
import resource
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

SOURCES = Path(__file__).resolve().parents[2] / "ros2_ws" / "src"
VERBS = SOURCES / "magat_cli" / "magat_cli" / "verb"
#: Libraries that take long to import, and ROS.
HEAVY = frozenset({"torch", "scipy", "pandas", "matplotlib", "aiohttp", "onnxruntime", "onnx", "rclpy"})
#: ROS is looked for by these names, too.
ROS = frozenset({"rclpy", "ament_index_python", "launch", "magat_interfaces", "std_msgs", "rcl_interfaces"})

COMPUTES = {"scipy"}
#: Which of the `HEAVY` ones each verb may import when it runs. Add a verb here.
ALLOWED = {
    "analyze": {"scipy", "pandas"},
    "bench_expert": {"scipy"},
    "bench_runtime": {"scipy", "rclpy", "aiohttp"},
    "bench_sim": COMPUTES | {"torch"},
    "bench_training": COMPUTES | {"torch"},
    "bench_view": {"scipy", "rclpy"},
    "data": {"scipy"},
    "deploy": {"rclpy"},
    "env": set(),
    "evaluate": COMPUTES | {"matplotlib"},
    "export": set(),
    "frontier": COMPUTES | {"matplotlib"},
    "measure": COMPUTES,
    "models": COMPUTES,
    "plot": {"scipy", "pandas", "matplotlib"},
    "pogema": COMPUTES,
    "record": {"rclpy"},
    "recover": set(),
    "replay": {"scipy", "rclpy", "aiohttp"},
    "results": COMPUTES | {"matplotlib"},
    "run": {"scipy", "rclpy", "matplotlib"},
    "train": COMPUTES | {"torch"},
    "tune": COMPUTES,
    "view": {"scipy", "rclpy", "aiohttp"},
}
NEED_ROS = {"bench_runtime", "bench_view", "deploy", "env", "record", "replay", "run", "view"}


@cache
def imported(path: Path, nested: bool) -> frozenset[str]:
    """Modules that a file imports, those under TYPE_CHECKING left out; in functions, too, if ``nested``."""
    found: set[str] = set()

    def visit(node: ast.AST) -> None:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            return
        if not nested and isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            return
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            found.add(node.module)
            found.update(f"{node.module}.{alias.name}" for alias in node.names)
        for child in ast.iter_child_nodes(node):
            visit(child)

    visit(ast.parse(path.read_text()))
    return frozenset(found)


def file_of(module: str) -> Path | None:
    """The source of one of our modules; None for any other name."""
    base = SOURCES / module.partition(".")[0] / Path(*module.split("."))
    return next((file for file in (base.with_suffix(".py"), base / "__init__.py") if file.is_file()), None)


def libraries(verb: str) -> set[str]:
    """Top-level names of all that is loaded once the imports of ``verb`` are made, in its functions and below."""
    waiting, seen, found = set(imported(VERBS / f"{verb}.py", True)), set(), set()
    while waiting:
        module = waiting.pop()
        if module in seen:
            continue
        seen.add(module)
        found.add(module.partition(".")[0])
        parent, file = module.rpartition(".")[0], file_of(module)
        if parent:
            waiting.add(parent)
        if file is not None:
            waiting |= imported(file, False)
    return found


def test_every_verb_is_in_the_table() -> None:
    assert {file.stem for file in VERBS.glob("*.py")} - {"__init__"} == ALLOWED.keys()


@pytest.mark.parametrize("verb", sorted(ALLOWED))
def test_a_verb_imports_no_more_than_it_may(verb: str) -> None:
    found = libraries(verb)
    assert found & HEAVY <= ALLOWED[verb]
    if verb not in NEED_ROS:
        assert not found & ROS, "the verb is to run without ROS"


def python(*arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run this Python without ROS in its environment."""
    dropped = ("AMENT_PREFIX_PATH", "COLCON_PREFIX_PATH", "CMAKE_PREFIX_PATH", "ROS_DISTRO", "PYTHONPATH")
    environment = {name: value for name, value in os.environ.items() if name not in dropped} | variables
    command = [sys.executable, *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=110)


def test_help_is_quick_and_imports_nothing_heavy() -> None:
    done = python("-X", "importtime", "-m", "magat_cli", "--help")
    assert done.returncode == 0 and "verbs:" in done.stdout
    loaded = {line.rpartition("|")[2].strip().partition(".")[0] for line in done.stderr.splitlines()}
    assert not loaded & {*HEAVY, *ROS, "numpy", "rich"}

    def seconds() -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        python("-m", "magat_cli", "--help")
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    # Of processor time, the best of a few: other tests and processes share the processors.
    assert min(seconds() for _ in range(5)) < 0.3


@pytest.mark.parametrize("verb", sorted(ALLOWED))
def test_the_help_of_a_verb_imports_nothing_heavy(verb: str) -> None:
    name = verb.replace("_", "-")
    done = python("-X", "importtime", "-m", "magat_cli", name, "--help")
    assert done.returncode == 0 and f"usage: magat {name}" in done.stdout
    loaded = {line.rpartition("|")[2].strip().partition(".")[0] for line in done.stderr.splitlines()}
    assert not loaded & {*HEAVY, *ROS}


#: Put in front of a program: this Python finds no ROS, whatever is installed.
BLOCK = f"""
import sys

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {set(ROS)!r}:
            raise ModuleNotFoundError(f"blocked: {{name}}", name=name)

sys.meta_path.insert(0, Blocker())
from magat_cli.main import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.parametrize(
    "command",
    [
        ["models"],
        ["evaluate", "--cases", "2", "--robots", "3", "--width", "8", "--height", "8", "--json"],
        ["data", "make", "--cases", "12", "--robots", "3", "--width", "8", "--height", "8", "--output", "DATA"],
        ["train", "none.yaml"],
        ["results", "--study", "none"],
    ],
    ids=lambda command: command[0],
)
def test_what_only_computes_runs_without_ros(command: list[str], tmp_path: Path) -> None:
    command = [str(tmp_path / "data") if part == "DATA" else part for part in command]
    done = python("-c", BLOCK, *command, OMP_NUM_THREADS="1")
    if command[0] in ("train", "results"):
        assert done.returncode == 1 and "magat: " in done.stderr and "none" in done.stderr
    else:
        assert done.returncode == 0, done.stderr
