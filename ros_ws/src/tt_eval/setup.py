"""Installs tt_eval."""

from setuptools import find_packages, setup

setup(
    name="tt_eval",
    version="0.1.0",
    packages=find_packages(),
    package_data={"tt_eval": ["*/*.yaml", "pages/*", "py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/tt_eval"]),
        ("share/tt_eval", ["package.xml"]),
        ("lib/tt_eval", ["scripts/arm", "scripts/evaluate", "scripts/experiment", "scripts/fit_sensor_error", "scripts/sweep"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    extras_require={"test": ["pytest"]},
)
