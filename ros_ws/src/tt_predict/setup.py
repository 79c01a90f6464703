"""Installs tt_predict."""

from setuptools import find_packages, setup

setup(
    name="tt_predict",
    version="0.1.0",
    packages=find_packages(),
    package_data={"tt_predict": ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/tt_predict"]),
        ("share/tt_predict", ["package.xml"]),
        ("lib/tt_predict", ["scripts/identify", "scripts/predict_node"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    extras_require={"test": ["pytest"]},
)
