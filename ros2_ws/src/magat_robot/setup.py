from setuptools import find_packages, setup

PACKAGE = "magat_robot"

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
    description="A robot: its policy, its part in the exchange of messages, and its ROS node.",
    license="Apache-2.0",
    entry_points={"console_scripts": ["robot = magat_robot.node:main", "robots = magat_robot.forked:main"]},
)
