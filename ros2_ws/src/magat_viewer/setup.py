# Copyright 2026 MAGAT maintainers
# SPDX-License-Identifier: Apache-2.0

from setuptools import find_packages, setup

PACKAGE = "magat_viewer"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["page/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,  # the page's files are served as files
    maintainer="MAGAT maintainers",
    maintainer_email="maintainers@magat.example",
    description="A local web page that shows a live or a recorded team.",
    license="Apache-2.0",
    entry_points={"console_scripts": ["viewer = magat_viewer.main:main", "rviz_bridge = magat_viewer.rviz.node:main"]},
)
