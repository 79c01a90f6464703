"""The commands of the README in every shell, in a folder whose name has a space and an umlaut, from where the user stands.

The folder is a copy of the project that is built there by scripts/setup. Only the installed packages of .venv are those of this one: to
install them takes minutes. Afterwards it is moved.
"""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
OURS = ("TT_", "ROS_", "AMENT_", "VIRTUAL_ENV", "PYTHON", "COLCON_", "CMAKE_", "FASTRTPS_", "LD_LIBRARY_PATH", "_ROS")
SHELLS = {"bash": "source", "zsh": "source", "dash": ".", "fish": "source"}
COMMANDS = (  # of the README, with what their output holds
    ("ros2 bag info bags/reference_back_5", "Topic: /ball/measured | Type: nav_msgs/msg/Odometry | Count: 1"),
    ("ros2 launch -p tt_bringup replay.launch.yaml bag:=bags/reference_back_5", "estimate_node"),
    ("ros2 run tt_vision calibrate --help", "usage: calibrate"),
    ("ros2 run tt_bringup compare bags/reference_back_5 bags/reference_back_5", "the recordings are equal"),
    ("ros2 pkg executables tt_arm", "tt_arm arm_node"),
)
README = (ROOT / "README.md").read_text()
LAUNCHES = [line.split("#")[0].strip() for line in README.splitlines() if line.startswith("ros2 launch ")]
GIVEN = sorted(set(re.findall(r"params_file:=([\w.]+)", "\n".join(LAUNCHES))))  # files that the reader of the README makes


@pytest.fixture(scope="module")
def clean():
    """The environment without this project."""
    found = {name: value for name, value in os.environ.items() if not name.startswith(OURS)}
    return {**found, "PATH": ":".join(part for part in found["PATH"].split(":") if not part.startswith(str(ROOT)))}


@pytest.fixture(scope="module")
def project(tmp_path_factory, clean):
    """The copy, set up. Its source has the bytecode and the compiled kernels of this one."""
    folder = tmp_path_factory.mktemp("shells") / "meine Ablage ü" / "tennis robot"
    built = ("build", "install", "log")
    shutil.copytree(ROOT / "ros_ws", folder / "ros_ws", ignore=shutil.ignore_patterns(*built))
    shutil.copytree(ROOT / "scripts", folder / "scripts")
    shutil.copytree(ROOT / "bags" / "reference_back_5", folder / "bags" / "reference_back_5")
    shutil.copy(ROOT / "requirements.txt", folder)
    (folder / ".venv").mkdir()
    for path in (ROOT / ".venv").iterdir():
        if path.name not in ("kernels.done", "colcon.log"):
            (folder / ".venv" / path.name).symlink_to(path)
    shutil.copy(ROOT / ".venv" / "kernels.done", folder / ".venv")
    set_up(folder, clean)
    return folder


def set_up(folder, clean):
    """Run scripts/setup, from another folder. The kernels came with the source, unless it has changed since its own set-up."""
    done = subprocess.run([folder / "scripts" / "setup"], cwd=folder.parent, env=clean, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr


def run(shell, script, folder, clean):
    if not shutil.which(shell):
        pytest.skip(f"{shell} is not installed")
    done = subprocess.run([shell, "-c", script], cwd=folder, env=clean, capture_output=True, text=True, timeout=120)
    assert not done.returncode, done.stdout + done.stderr
    return done.stdout + done.stderr


@pytest.mark.parametrize("shell", SHELLS)
def test_the_commands_of_the_readme_run(project, clean, shell):
    env = "scripts/env.fish" if shell == "fish" else "./scripts/env"
    script = "\n".join([f"{SHELLS[shell]} {env}", *(command for command, _ in COMMANDS)])
    text = run(shell, script, project, clean)
    for command, part in COMMANDS:
        assert part in text, command
    assert str(ROOT) not in text


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_launch_lines_of_the_readme_are_taken(project, clean, shell):
    """Every third one, with -p, which prints what would be started; test_readme.py reads them all."""
    for name in GIVEN:
        (project / name).touch()
    lines = [line.replace("ros2 launch ", "ros2 launch -p ", 1) for line in LAUNCHES[::3]]
    text = run(shell, "\n".join(["source ./scripts/env", "set -e", *lines]), project, clean)
    assert len(lines) >= 5 and text.count("estimate_node") >= len(lines) - 2  # a machine without vision has none


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_it_is_sourced_from_anywhere_and_paths_are_those_of_the_user(project, clean, shell, tmp_path):
    script = f"source '{project}/scripts/env' && ros2 run tt_bringup reprocess bag --from predict -o 'neu e' && ros2 bag info 'neu e'"
    (tmp_path / "bag").symlink_to(project / "bags" / "reference_back_5")
    assert "Topic: /ball/path" in run(shell, script, tmp_path, clean)
    assert (tmp_path / "neu e" / "metadata.yaml").is_file()


def test_a_moved_folder_says_how_and_repairs_itself(project, clean):
    moved = project.with_name("moved")
    project.rename(moved)
    try:
        done = subprocess.run(["bash", "-c", ". ./scripts/env"], cwd=moved, env=clean, capture_output=True, text=True, timeout=120)
        assert done.stderr.count("\n") == 1 and "scripts/setup" in done.stderr
        set_up(moved, clean)
        assert "tt_arm arm_node" in run("bash", ". ./scripts/env && ros2 pkg executables tt_arm", moved, clean)
    finally:
        moved.rename(project)
