"""Installs tt_bringup."""

from pathlib import Path

from setuptools import find_packages, setup

here = Path(__file__).parent


def files(folder):
    """Return the paths of all files in a folder."""
    return [str(path.relative_to(here)) for path in sorted((here / folder).iterdir()) if path.is_file()]


setup(
    name="tt_bringup",
    version="0.1.0",
    packages=find_packages(),
    package_data={"tt_bringup": ["py.typed", "report/*.js", "report/*.css"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/tt_bringup"]),
        ("share/tt_bringup", ["package.xml"]),
        (
            "lib/tt_bringup",
            [
                "scripts/compare",
                "scripts/learn_node",
                "scripts/locate",
                "scripts/marker_node",
                "scripts/report",
                "scripts/reprocess",
                "scripts/robot_state_publisher",
                "scripts/view_node",
            ],
        ),
        ("share/tt_bringup/launch", files("launch")),
        ("share/tt_bringup/config", files("config")),
        *(
            (f"share/tt_bringup/config/{arm.name}", files(f"config/{arm.name}"))
            for arm in sorted((here / "config").iterdir())
            if arm.is_dir()
        ),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    extras_require={"test": ["pytest"]},
)
