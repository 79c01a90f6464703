"""Installs tt_sim."""

from setuptools import find_packages, setup

setup(
    name="tt_sim",
    version="0.1.0",
    packages=find_packages(),
    package_data={"tt_sim": ["*/*.yaml", "py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/tt_sim"]),
        ("share/tt_sim", ["package.xml"]),
        ("lib/tt_sim", ["scripts/sim_node"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    extras_require={"test": ["pytest"]},
)
