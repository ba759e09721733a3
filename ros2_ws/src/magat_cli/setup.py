# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

from setuptools import find_packages, setup

PACKAGE = "magat_cli"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=True,
    maintainer="MAGAT maintainers",
    maintainer_email="maintainers@magat.example",
    description="The magat command: one module for each verb.",
    license="Apache-2.0",
    entry_points={"console_scripts": ["magat = magat_cli.main:main"]},
)
