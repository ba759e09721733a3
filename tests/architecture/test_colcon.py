"""``colcon test`` finds the tests of each package, which are in ``tests/`` at the top of the repository."""

import json
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
