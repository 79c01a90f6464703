"""Installs tt_tools."""

from setuptools import find_packages, setup

setup(
    name="tt_tools",
    version="0.1.0",
    packages=find_packages(),
    package_data={"tt_tools": ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/tt_tools"]),
        ("share/tt_tools", ["package.xml"]),
        ("lib/tt_tools", ["scripts/play_node", "scripts/record_node"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    extras_require={"test": ["pytest"]},
)
