from glob import glob

from setuptools import find_packages, setup

PACKAGE = "magat_bringup"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/config", sorted(glob("config/*"))),
        (f"share/{PACKAGE}/launch", sorted(glob("launch/*"))),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    maintainer="MAGAT maintainers",
    maintainer_email="maintainers@magat.example",
    description="All of it together: launch files, parameters, the magat command, recorder and viewer.",
    license="Apache-2.0",
    entry_points={"console_scripts": ["magat = magat_bringup.cli:main"]},
)
