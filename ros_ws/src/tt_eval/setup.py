"""Installs tt_eval."""

from setuptools import find_packages, setup

setup(
    name="tt_eval",
    version="0.1.0",
    packages=find_packages(),
    package_data={"tt_eval": ["*/*.yaml", "py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/tt_eval"]),
        ("share/tt_eval", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    extras_require={"test": ["pytest"]},
    entry_points={
        "console_scripts": [
            "experiment = tt_eval.experiments.main:main",
            "fit_sensor_error = tt_eval.sensor_error_fit:main",
            "sweep = tt_eval.sweep:main",
            "evaluate = tt_eval.evaluate:main",
        ]
    },
)
