"""Each arm that comes with the workspace plays a ball, as the PA10 does in test_rally.py: the whole robot, every node a process."""

import json
import sys

import pytest
from nodes.test_rally import run
from tt_core.robots import DEFAULT_ROBOT, robots


@pytest.mark.parametrize("robot", sorted(set(robots()) - {DEFAULT_ROBOT}))
def test_it_plays_a_ball(robot, tmp_path):
    out, figures = tmp_path / "out", tmp_path / "demo.json"
    options = {"robot": robot, "balls": 1, "seed": 3, "rtf": 0.3, "json": figures, "out": out}
    words = [word for name, value in options.items() for word in (f"--{name}", str(value))]
    done = run([sys.executable, "-m", "tt_bringup.demo", *words], tmp_path, 200)
    log = out / "log.txt"
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}\n{log.read_text() if log.exists() else ''}"
    (ball,) = json.loads(figures.read_text())["balls"]
    assert ball["seen"] and ball["hit"] and ball["landed"], (ball, done.stdout)
    assert (out / "report.html").is_file()


def test_an_arm_that_there_is_not_is_told_at_once(tmp_path):
    done = run([sys.executable, "-m", "tt_bringup.demo", "--robot", "nobody", "--out", str(tmp_path / "out")], tmp_path, 60)
    assert done.returncode == 2 and "pa10" in done.stderr and not (tmp_path / "out").exists()
