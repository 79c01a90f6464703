"""Installs tt_vision."""

from setuptools import find_packages, setup

setup(
    name="tt_vision",
    version="0.1.0",
    packages=find_packages(),
    package_data={"tt_vision": ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/tt_vision"]),
        ("share/tt_vision", ["package.xml"]),
        ("lib/tt_vision", ["scripts/calibrate", "scripts/camera_node", "scripts/estimate_node"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    extras_require={"test": ["pytest"]},
)
