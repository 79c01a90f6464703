from setuptools import find_packages, setup

setup(
    name="tt_vision",
    version="0.1.0",
    packages=find_packages(),
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/tt_vision"]),
        ("share/tt_vision", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    extras_require={"test": ["pytest"]},
    entry_points={
        "console_scripts": [
            "calibrate = tt_vision.calibrate:main",
            "camera_node = tt_vision.camera_node:main",
            "estimate_node = tt_vision.estimate_node:main",
        ],
    },
)
