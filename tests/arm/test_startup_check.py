"""An arm that cannot play says so at the start, with numbers."""

import numpy as np
import pytest
from tt_arm.joints import Joints
from tt_arm.model import URDF, ArmModel
from tt_arm.reach import reach
from tt_arm.startup_check import check_feasible, strokes
from tt_arm.swing import SwingLimits, plan
from tt_core.errors import TtError

MODEL = ArmModel.pa10()


def test_this_arm_can_play():
    check_feasible(MODEL, SwingLimits())
    start = Joints(0.0, MODEL.waiting, np.zeros(7))
    assert all(plan(MODEL, start, reach(MODEL, racket, MODEL.waiting), racket.time).reason is None for racket in strokes())


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"base": (-2.0, 0.7625, -0.06, 0.0)},
            r"base = \(-2, 0.7625, -0.06\) .* 0 of 12 strokes, 6 needed: out of reach; .* 1.98 m from the",
        ),
        ({"mount": (0.15, 0.0)}, "with this mount makes [0-5] of 12 strokes"),  # a racket square to the flange's axis
        ({"waiting": np.radians((0, 80, 0, 60, -80, 70, 110))}, "waiting = .* mm from the table, 10 mm wanted"),
    ],
)
def test_an_arm_that_cannot_play_is_told(changes, words):
    with pytest.raises(TtError, match=words):
        check_feasible(ArmModel.pa10(**changes), SwingLimits())


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<robot", "<nonsense", "cannot be read"),
        ('name="w2" type="revolute"', 'name="w2" type="fixed"', "has 6 joints .* wanted 7 revolute ones"),
        ('<axis xyz="0 1 0"/>', '<axis xyz="1 0 0"/>', "joint s2 is a RX, wanted one about y"),
        ('velocity="2"', 'velocity="0"', "joint s3 has limits .* 0 rad/s"),
        ('xyz="0 0 0.315"', 'xyz="0 0.1 0.315"', "joint s2 stands at .* wanted straight above"),
    ],
)
def test_a_bad_urdf_is_told(tmp_path, old, new, words):
    bad = tmp_path / "bad.urdf"
    bad.write_text(URDF.read_text().replace(old, new))
    with pytest.raises(TtError, match=words):
        ArmModel.pa10(urdf=str(bad))


def test_a_waiting_posture_beyond_a_limit_is_told():
    with pytest.raises(TtError, match="waiting angle of joint s1 = 4 is outside"):
        ArmModel.pa10(waiting=(4.0, 0, 0, 0, 0, 0, 0))
