# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""``colcon test`` finds the tests of each package, which are in ``tests/`` at the top of the repository."""

import json
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ROOT / "ros2_ws" / "src"
#: Folders of tests that belong to no single package: `colcon test` leaves them out, `make test` does not.
WHOLE = {"architecture", "docs", "system"}
PYTHON_PACKAGES = sorted(path.parent for path in SOURCES.glob("*/setup.py"))


def own_tests(package: Path) -> Path:
    return ROOT / "tests" / package.name.removeprefix("magat_")


@pytest.mark.parametrize("package", PYTHON_PACKAGES, ids=lambda package: package.name)
def test_a_python_package_is_tested_by_pytest(package: Path) -> None:
    # colcon takes pytest where the extra "test" names it, and its arguments from colcon.pkg.
    assert 'extras_require={"test": ["pytest"]}' in (package / "setup.py").read_text()
    paths = json.loads((package / "colcon.pkg").read_text())["pytest-args"]
    assert [(package / path).resolve() for path in paths] == [own_tests(package)]
    assert list(own_tests(package).glob("test_*.py"))


def test_the_expert_is_tested_by_ctest() -> None:
    assert (
        "ament_add_pytest_test(expert ../../../tests/expert " in (SOURCES / "magat_expert/CMakeLists.txt").read_text()
    )


def test_every_manifest_names_what_tests_need() -> None:
    for package in SOURCES.glob("*/package.xml"):
        needed = {element.text for element in ET.parse(package).getroot().iter("test_depend")}
        assert package.parent.name == "magat_interfaces" or "python3-pytest" in needed, package


def test_no_folder_of_tests_is_left_out() -> None:
    folders = {path.parent.name for path in (ROOT / "tests").glob("*/test_*.py")}
    packages = {path.parent.name.removeprefix("magat_") for path in SOURCES.glob("*/package.xml")}
    assert folders <= packages | WHOLE


def colcon(*arguments: str, **options: str) -> str:
    command = [sys.executable, "-m", "colcon", *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True, timeout=110, **options).stdout


def test_a_checkout_in_a_workspace_holds_our_packages_and_no_others(tmp_path: Path) -> None:
    (tmp_path / "src").mkdir()
    (tmp_path / "src" / "checkout").symlink_to(ROOT)
    listed = colcon("--log-base", os.devnull, "list", "--names-only", "--base-paths", "src", cwd=tmp_path)
    assert sorted(listed.split()) == sorted(path.parent.name for path in SOURCES.glob("*/package.xml"))


def test_a_plain_build_installs_the_policies_and_finds_them(tmp_path: Path) -> None:
    build = [
        "build",
        "--base-paths",
        str(SOURCES / "magat_robot"),
        "--build-base",
        "build",
        "--install-base",
        "install",
    ]
    colcon("--log-base", "log", *build, cwd=tmp_path)
    package = tmp_path / "install" / "magat_robot"
    (modules,) = package.glob("lib/python*/site-packages")
    program = (
        f"import sys; sys.path.insert(0, {str(modules)!r}); from magat_robot.policy.models import all_policies; "
        "from magat_robot.policy.backends import ensure_exported; policies = all_policies(); "
        "[ensure_exported(folder) for folder in policies.values()]; print(*map(str, policies.values()))"
    )
    found = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True)
    shipped = sorted(path.parent.name for path in ROOT.glob("models/*/config.json"))
    assert found.stdout.split() == [str(package / "share" / "magat_robot" / "models" / name) for name in shipped]


def test_what_apt_lacks_is_pinned_as_elsewhere() -> None:
    def pins(*names: str) -> set[str]:
        lines = [line for name in names for line in (ROOT / f"requirements-{name}.txt").read_text().splitlines()]
        return {line for line in lines if line and not line.startswith("#")}

    assert pins("apt") <= pins("robot", "team")
