"""Installs tt_arm."""

from setuptools import find_packages, setup

setup(
    name="tt_arm",
    version="0.1.0",
    packages=find_packages(),
    package_data={"tt_arm": ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/tt_arm"]),
        ("share/tt_arm", ["package.xml"]),
        ("lib/tt_arm", ["scripts/arm_node", "scripts/enable"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    extras_require={"test": ["pytest"]},
)
