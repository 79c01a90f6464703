"""Installation of the package."""

from setuptools import find_packages, setup

setup(
    name="tt_arm",
    version="0.1.0",
    packages=find_packages(),
    package_data={"tt_arm": ["urdf/*.urdf", "py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/tt_arm"]),
        ("share/tt_arm", ["package.xml"]),
        ("lib/tt_arm", ["scripts/arm_node", "scripts/enable"]),
        ("share/tt_arm/urdf", ["tt_arm/urdf/pa10.urdf"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    extras_require={"test": ["pytest"]},
)
