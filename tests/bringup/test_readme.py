"""What the README tells people to type is what the programs take."""

import re
import shlex
import subprocess
from pathlib import Path

import pytest
from tt_tools import launch, packages
from tt_tools.ros2 import parser

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```", README, re.S | re.M)
LINES = [line.split("#")[0].strip() for language, block in BLOCKS if not language for line in block.splitlines()]
ROS2 = [shlex.split(line)[1:] for line in LINES if line.startswith("ros2 ")]
SCRIPTS = sorted({word for line in LINES for word in line.split() if word.startswith("scripts/")})


def test_there_is_something_to_check():
    assert len(ROS2) >= 6
    assert {"scripts/demo", "scripts/test", "scripts/env"} <= set(SCRIPTS)


@pytest.mark.parametrize("words", ROS2, ids=" ".join)
def test_the_ros2_command_takes_the_line(words, tmp_path, monkeypatch):
    args = parser().parse_args(words)
    if words[0] == "run":
        assert packages.executable(args.package_name, args.executable_name).is_file()
    if words[0] == "launch":
        given = dict(word.split(":=", 1) for word in words if ":=" in word)
        if "more_params_file" in given:  # which the reader makes
            (tmp_path / given["more_params_file"]).touch()
            monkeypatch.chdir(tmp_path)
        if given.get("params_file"):
            given["params_file"] = str(ROOT / given["params_file"])
        assert launch.processes(packages.launch_file(*[word for word in words[1:] if ":=" not in word]), given)


@pytest.mark.parametrize("script", SCRIPTS)
def test_the_script_is_there(script):
    assert (ROOT / script).is_file()


def test_the_demo_takes_the_options_that_the_readme_names():
    options = re.search(r"`(--balls [^`]*)`", README)[1]
    text = subprocess.run(["python", "-m", "tt_bringup.demo", "--help"], capture_output=True, text=True, check=True).stdout
    for option in re.findall(r"--\w+ \w+", options):
        assert option in text


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--balls", "0"], "--balls 0"),
        (["--rtf", "99"], "--rtf 99"),
        (["--seed", "x"], "--seed"),
        (["--out", "/proc/x"], "/proc/x"),
        (["--json", "/no/x.json"], "/no/x.json"),
    ],
)
def test_the_demo_refuses_nonsense(words, named, tmp_path):
    command = ["python", "-m", "tt_bringup.demo", *words]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)  # it may have made its output folder there
    assert done.returncode == 2 and named in done.stderr
