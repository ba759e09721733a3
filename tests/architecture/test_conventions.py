# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

"""What ROS's conventions ask of each package: its manifest, changelog, and the notice in its sources."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = sorted(path.parent for path in (ROOT / "ros2_ws" / "src").glob("*/package.xml"))
NOTICE = re.compile(r"(#!.*\n)?(#|//) Copyright 20\d\d MAGAT maintainers\n\2 SPDX-License-Identifier: Apache-2\.0\n")
SOURCES = ("*.py", "*.pyi", "*.cpp", "*.hpp", "*.js", "CMakeLists.txt")

each_package = pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.name)


def sources() -> list[Path]:
    """All source files, those in links to other folders left out."""
    folders = (ROOT / "ros2_ws" / "src", ROOT / "tests", ROOT / "tools")
    return [path for folder in folders for pattern in SOURCES for path in folder.rglob(pattern)]


def test_every_source_names_its_copyright_and_license() -> None:
    assert len(sources()) > 300
    without = [str(path.relative_to(ROOT)) for path in sources() if not NOTICE.match(path.read_text())]
    assert not without, f"begin with the two lines of {Path(__file__).name}: {', '.join(without)}"


@each_package
def test_a_manifest_says_who_what_and_where(package: Path) -> None:
    manifest = ET.parse(package / "package.xml").getroot()
    for tag in ("name", "version", "description", "maintainer", "license", "url", "author"):
        element = manifest.find(tag)
        assert element is not None and element.text, f"package.xml of {package.name} has no <{tag}>"
    assert manifest.findtext("license") == "Apache-2.0"
    assert manifest.find("maintainer").attrib["email"]


@each_package
def test_all_files_name_the_same_version(package: Path) -> None:
    version = ET.parse(package / "package.xml").getroot().findtext("version")
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    setup = package / "setup.py"
    assert not setup.exists() or f'version="{version}"' in setup.read_text()


@each_package
def test_a_changelog_has_the_form_of_catkin(package: Path) -> None:
    bar, title, under, _, section, _ = (package / "CHANGELOG.rst").read_text().splitlines()[:6]
    assert title == f"Changelog for package {package.name}"
    assert bar == under == "^" * len(title)
    assert section == "Forthcoming" or re.match(r"\d+\.\d+\.\d+ \(\d{4}-\d{2}-\d{2}\)", section)
