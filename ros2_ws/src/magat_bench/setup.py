# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

from setuptools import find_packages, setup

PACKAGE = "magat_bench"

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
    description="Benchmarks of the expert, the simulator, training, a running team and its page.",
    license="Apache-2.0",
)
