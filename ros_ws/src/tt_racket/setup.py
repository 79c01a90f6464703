from setuptools import find_packages, setup

setup(
    name="tt_racket",
    version="0.1.0",
    packages=find_packages(),
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/tt_racket"]),
        ("share/tt_racket", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    extras_require={"test": ["pytest"]},
    entry_points={"console_scripts": ["racket_node = tt_racket.racket_node:main"]},
)
