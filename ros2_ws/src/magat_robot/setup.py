# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "magat_robot"
# What a team needs of a policy.
POLICY_FILES = ("config.json", "model.safetensors", "card.md", "measures.json", "onnx/*")


def policies() -> list[tuple[str, list[str]]]:
    """The policies (the folder models here is a link to that of the repository), for ``share/``."""
    files: dict[str, list[str]] = {}
    for pattern in POLICY_FILES:
        for path in Path("models").glob(f"*/{pattern}"):
            if path.is_file():  # colcon's build folder keeps links to files that are there no more
                files.setdefault(f"share/{PACKAGE}/{path.parent}", []).append(str(path))
    return sorted(files.items())


setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        *policies(),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=True,
    maintainer="MAGAT maintainers",
    maintainer_email="maintainers@magat.example",
    description="A robot: its policy, its part in the exchange of messages, and its ROS node.",
    license="Apache-2.0",
    entry_points={"console_scripts": ["robot = magat_robot.node:main", "robots = magat_robot.forked:main"]},
)
