"""The rules that keep the house in order (ARCHITECTURE.md), held."""

import ast
from pathlib import Path

import pytest

SRC = Path(__file__).parents[1] / "ros_ws" / "src"
PACKAGES = sorted(p.name for p in SRC.iterdir() if p.is_dir())
FILES = sorted(SRC.glob("tt_*/tt_*/**/*.py"))
MAY_IMPORT_ALL = {"tt_sim": set(PACKAGES) - {"tt_bringup"}, "tt_bringup": set(PACKAGES)}
ROS = {"rclpy", "rosgraph_msgs", "sensor_msgs", "nav_msgs", "geometry_msgs", "std_msgs", "std_srvs", "trajectory_msgs", "diagnostic_msgs"}


def imports(path):
    """Top-level names of all modules that a file imports, wherever in it."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield node.module.split(".")[0]


def relative(path):
    return path.relative_to(SRC).as_posix()


def test_there_is_something_to_check():
    assert {"tt_core", "tt_vision", "tt_predict", "tt_racket", "tt_arm", "tt_sim", "tt_bringup"} <= set(PACKAGES)
    assert len(FILES) > 30


@pytest.mark.parametrize("path", FILES, ids=relative)
def test_a_package_imports_the_vocabulary_and_no_sibling(path):
    package = path.relative_to(SRC).parts[0]
    allowed = {package, "tt_core"} | MAY_IMPORT_ALL.get(package, set())
    assert {name for name in imports(path) if name in PACKAGES} <= allowed


@pytest.mark.parametrize("path", FILES, ids=relative)
def test_ros_is_known_to_nodes_only(path):
    is_ros = path.name.endswith("_node.py") or "tt_core/ros/" in relative(path) or relative(path) == "tt_bringup/tt_bringup/demo.py"
    assert is_ros or not set(imports(path)) & ROS


@pytest.mark.parametrize("path", FILES, ids=relative)
def test_the_truth_is_known_to_the_simulator_only(path):
    """No node outside tt_sim reads /sim/*: the recorder takes every topic without naming any, the report page evaluates a recording."""
    if relative(path).startswith("tt_sim/") or relative(path) == "tt_bringup/tt_bringup/report.py":
        return
    strings = {n.value for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Constant) and isinstance(n.value, str)}
    assert not any(text.startswith("/sim/") for text in strings)


def test_launch_files_remap_no_truth_to_the_robot():
    for path in SRC.glob("tt_*/launch/*.yaml"):
        assert "/sim/" not in path.read_text(), path


@pytest.mark.parametrize("path", [p for p in FILES if p.name.endswith("_node.py")], ids=relative)
def test_a_node_has_an_executable(path):
    package = path.relative_to(SRC).parts[0]
    if path.stem == "graph_node":  # behind words of the ros2 command
        return
    assert any(f'start("{package}.{path.stem}")' in script.read_text() for script in (SRC / package / "scripts").iterdir())


@pytest.mark.parametrize("path", [*FILES, *SRC.glob("tt_*/launch/*.yaml")], ids=relative)
def test_every_file_says_what_it_is(path):
    text = path.read_text()
    assert text.startswith("#") if path.suffix == ".yaml" else ast.get_docstring(ast.parse(text)), f"{path} has no first line about itself"
