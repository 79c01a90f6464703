from setuptools import find_packages, setup

setup(
    name="tt_sim",
    version="0.1.0",
    packages=find_packages(),
    package_data={"tt_sim": ["*/*.yaml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/tt_sim"]),
        ("share/tt_sim", ["package.xml"]),
        ("lib/tt_sim", ["scripts/sim_node"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    extras_require={"test": ["pytest"]},
    entry_points={
        "console_scripts": [
            "experiment = tt_sim.experiments.main:main",
            "sight = tt_sim.sight_fit:main",
            "sweep = tt_sim.sweep:main",
            "evaluate = tt_sim.evaluate:main",
        ]
    },
)
