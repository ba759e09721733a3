# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "magat_bringup"


def files(folder: str) -> list[str]:
    """What is in it: colcon's build folder keeps links to files that are there no more."""
    return sorted(path for path in glob(f"{folder}/*") if Path(path).is_file())


setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/config", files("config")),
        (f"share/{PACKAGE}/launch", files("launch")),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=True,
    maintainer="MAGAT maintainers",
    maintainer_email="maintainers@magat.example",
    description="Starts a team: launch file, parameters, processes, network, and the client that runs episodes.",
    license="Apache-2.0",
    entry_points={"console_scripts": ["discovery_server = magat_bringup.discovery:main"]},
)
