"""Installs tt_racket."""

from setuptools import find_packages, setup

setup(
    name="tt_racket",
    version="0.1.0",
    packages=find_packages(),
    package_data={"tt_racket": ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/tt_racket"]),
        ("share/tt_racket", ["package.xml"]),
        ("lib/tt_racket", ["scripts/racket_node"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    extras_require={"test": ["pytest"]},
)
