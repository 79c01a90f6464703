"""An arm file names a URDF and where the arm stands."""

import numpy as np
import pytest
from arm.own_urdfs import EIGHT, SIX
from tt_arm.arm_file import load_arm
from tt_arm.arm_urdf.urdf import UrdfError
from tt_arm.model import ArmModel
from tt_core.constants import COMMAND_TIMEOUT
from tt_core.hit_windows import HIT_WINDOWS, RACKET_SPEED, HitWindow
from tt_core.robots import read_arm, robots
from tt_core.strict_yaml import BadFile

FILE = """
urdf: urdf/arm.urdf
tip: flange
base: [-0.6, 0.76, -0.1, 0.2]
mount: [0.15, 1.5]
waiting: [0, 0.1, 0.3, 0.5, 0.7, 0, 0.4, 0]
limits: {j1: {velocity: 3.0, acceleration: 12.0}}
left_out: []
"""


def written(tmp_path, text, urdf=EIGHT):
    (tmp_path / "urdf").mkdir(exist_ok=True)
    (tmp_path / "urdf" / "arm.urdf").write_text(urdf)
    (tmp_path / "arm.yaml").write_text(text)
    return str(tmp_path / "arm.yaml")


def test_the_file_is_the_arm(tmp_path):
    arm = load_arm(written(tmp_path, FILE))
    same = ArmModel.from_urdf(tmp_path / "urdf" / "arm.urdf", "flange", (-0.6, 0.76, -0.1, 0.2), (0.15, 1.5))
    q = arm.waiting
    assert q == pytest.approx([0, 0.1, 0.3, 0.5, 0.7, 0, 0.4, 0])
    assert arm.racket(q)[0] == pytest.approx(same.racket(q)[0], abs=1e-12)
    assert (arm.speed_limits[2], arm.limits.acceleration[2]) == (3.0, 12.0)


def test_joints_are_fixed_by_the_file(tmp_path):
    arm = load_arm(written(tmp_path, "urdf: urdf/arm.urdf\ntip: flange\nfixed: {x: 0.1}\n"))
    assert arm.names == ("y", "j1", "j2", "j3", "j4", "j5", "j6")


@pytest.mark.parametrize("name", ["", "pa10"])
def test_without_a_file_it_is_the_pa10(name):
    assert np.array_equal(load_arm(name).waiting, ArmModel.pa10().waiting)


def test_a_robot_is_a_name_a_folder_or_a_file(tmp_path):
    assert {"pa10", "frame5"} <= set(robots())
    for robot in ("frame5", str(robots()["frame5"]), str(robots()["frame5"] / "arm.yaml")):
        assert load_arm(robot).names == ("y", "x", "r1", "r2", "r3")
    moved = load_arm("frame5", base=(0.1, 0.7625, 0.0, 0.0), waiting=(0.1, 0.4, 0.0, 0.0, 0.0))
    assert moved.racket(moved.waiting)[0] == pytest.approx(load_arm("frame5").racket(moved.waiting)[0] + [0.1, 0.0, 0.0])
    written(tmp_path, FILE)
    assert load_arm(str(tmp_path)).names[0] == "x"


def test_a_file_says_where_the_arm_hits_and_what_its_drives_do(tmp_path):
    given, _ = read_arm(written(tmp_path, FILE))
    assert (given.hit_window, given.racket_speed, given.command_timeout) == (HIT_WINDOWS["near"], RACKET_SPEED, COMMAND_TIMEOUT)
    window = "hit_window: {x_low: -0.6, x_high: 0.1, y_low: 0, y_high: 1.5, z_low: 0.1, z_high: 0.8}\nracket_speed: 6.0\n"
    given, _ = read_arm(written(tmp_path, FILE + window))
    assert given.hit_window == HitWindow(-0.6, 0.1, 0.0, 1.5, 0.1, 0.8) and given.racket_speed == 6.0
    for wrong in (window.replace("0.1,", "-0.7,"), window.replace("6.0", "-1.0"), window.replace("x_low: -0.6, ", "")):
        with pytest.raises(BadFile):
            read_arm(written(tmp_path, FILE + wrong))


@pytest.mark.parametrize("text", ["tip: flange\n", FILE + "colour: red\n", FILE.replace("0.15", "far"), "- 1\n"])
def test_a_wrong_file_is_refused(tmp_path, text):
    with pytest.raises(BadFile):
        load_arm(written(tmp_path, text))


def test_a_missing_file_and_a_missing_urdf_are_refused(tmp_path):
    with pytest.raises(BadFile):
        load_arm(str(tmp_path / "nothing.yaml"))
    with pytest.raises(UrdfError):
        load_arm(written(tmp_path, FILE.replace("urdf/arm.urdf", "nothing.urdf"), SIX))
