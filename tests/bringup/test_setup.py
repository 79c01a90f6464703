"""scripts/setup chooses where ROS comes from and says in one line what is missing."""

import fcntl
import os
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor, wait
from pathlib import Path

import pytest
from refusals import check_named

ROOT = Path(__file__).parents[2]


@pytest.fixture
def setup(tmp_path):
    """setup(*args, **environment) runs a copy of scripts/setup in a tree that has never been set up."""
    shutil.copytree(ROOT / "scripts", tmp_path / "tree" / "scripts")
    shutil.copy(ROOT / "requirements.txt", tmp_path / "tree")
    ours = ("TT_", "ROS_", "AMENT_", "VIRTUAL_ENV", "PYTHON", "COLCON_")
    clean = {name: value for name, value in os.environ.items() if not name.startswith(ours)}

    def setup(*args, **environment):
        script = tmp_path / "tree" / "scripts" / "setup"
        return subprocess.run([str(script), *args], env={**clean, **environment}, capture_output=True, text=True, timeout=120)

    return setup


@pytest.fixture
def prefix(tmp_path):
    """What a sourced ROS 2 looks like."""
    (tmp_path / "ros" / "lib").mkdir(parents=True)
    (tmp_path / "ros" / "lib" / "librcl.so").touch()
    return tmp_path / "ros"


def test_a_sourced_jazzy_is_used(setup, prefix):
    assert setup("--plan", ROS_DISTRO="jazzy", AMENT_PREFIX_PATH=str(prefix)).stdout.startswith("ros=apt ")


def test_a_workspace_sourced_over_it_does_not_hide_it(setup, prefix, tmp_path):
    (tmp_path / "overlay").mkdir()
    assert setup("--plan", ROS_DISTRO="jazzy", AMENT_PREFIX_PATH=f"{tmp_path / 'overlay'}:{prefix}").stdout.startswith("ros=apt ")


def test_else_the_wheels_are_used(setup, prefix):
    assert setup("--plan").stdout.startswith("ros=wheels ")
    assert setup("--plan", ROS_DISTRO="humble", AMENT_PREFIX_PATH=str(prefix)).stdout.startswith("ros=wheels ")
    assert setup("--plan", ROS_DISTRO="jazzy", AMENT_PREFIX_PATH="/no/such").stdout.startswith("ros=wheels ")


def test_two_at_once_run_one_after_the_other(setup, tmp_path):
    with (tmp_path / "tree" / "scripts" / "setup").open() as script, ThreadPoolExecutor() as executor:
        fcntl.flock(script, fcntl.LOCK_EX)
        second = executor.submit(setup, PYTHON="/no/such/python")  # it ends where it would make .venv
        assert wait([second], timeout=2.0).not_done
        fcntl.flock(script, fcntl.LOCK_UN)
        done = second.result(timeout=120.0)
    assert done.stdout.startswith("setup: waiting") and done.returncode == 1


def test_no_interpreter_is_told_in_one_line(setup, tmp_path):
    tools = tmp_path / "bin"
    tools.mkdir()
    for tool in ("bash", "cat", "dirname", "flock", "grep", "sha256sum", "tr", "uname"):
        (tools / tool).symlink_to(shutil.which(tool))
    for done in (setup(PYTHON="/no/such/python"), setup(PATH=str(tools))):
        assert done.returncode == 1 and done.stderr.count("\n") == 1
        check_named(done.stderr, "sudo apt install python3")


def test_no_venv_module_is_told_in_one_line(setup, tmp_path):
    python = tmp_path / "python"
    python.write_text('#!/bin/sh\ncase "$2" in *venv*) exit 1 ;; esac\nexec python3 "$@"\n')
    python.chmod(0o755)
    done = setup(PYTHON=str(python))
    assert done.returncode == 1 and done.stderr.count("\n") == 1
    check_named(done.stderr, "sudo apt install python3-venv")
