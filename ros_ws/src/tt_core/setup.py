"""Installs tt_core."""

from setuptools import find_packages, setup

setup(
    name="tt_core",
    version="0.1.0",
    packages=find_packages(),
    package_data={"tt_core": ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/tt_core"]),
        ("share/tt_core", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    extras_require={"test": ["pytest"]},
)
