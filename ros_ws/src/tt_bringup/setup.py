"""Installs tt_bringup."""

from pathlib import Path

from setuptools import find_packages, setup

here = Path(__file__).parent


def files(folder):
    """Return the paths of all files in a folder."""
    return [str(path.relative_to(here)) for path in sorted((here / folder).iterdir())]


setup(
    name="tt_bringup",
    version="0.1.0",
    packages=find_packages(),
    package_data={"tt_bringup": ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/tt_bringup"]),
        ("share/tt_bringup", ["package.xml"]),
        (
            "lib/tt_bringup",
            [f"scripts/{name}" for name in ("compare", "marker_node", "reprocess", "robot_state_publisher", "view_node")],
        ),
        ("share/tt_bringup/launch", files("launch")),
        ("share/tt_bringup/config", files("config")),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    extras_require={"test": ["pytest"]},
)
