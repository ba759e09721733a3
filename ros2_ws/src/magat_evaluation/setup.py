# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

from setuptools import find_packages, setup

PACKAGE = "magat_evaluation"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["*.md"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,  # the template of the page of results is read as a file
    maintainer="MAGAT maintainers",
    maintainer_email="maintainers@magat.example",
    description="Measures policies and baselines on sets of cases, and writes the page of results; no ROS.",
    license="Apache-2.0",
)
