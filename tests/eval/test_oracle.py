"""The oracle knows which balls an arm can reach."""

from dataclasses import replace

import pytest
from tt_arm.model import ArmModel
from tt_eval.episode import Trial, play
from tt_eval.oracle import reachable
from tt_eval.scenario import load
from tt_racket.intercept import InterceptParams

SCENARIO, MODEL = load("real", robot="measured", images=False), ArmModel.pa10()


@pytest.mark.parametrize("seed", range(4))
def test_what_is_hit_can_be_reached(seed):
    found = reachable(Trial.drawn(SCENARIO, seed), MODEL)
    assert found.swing is not None or play(SCENARIO, seed).outcome.hit is None


def test_a_ball_that_comes_nowhere_near_cannot():
    away = replace(SCENARIO, robot=replace(SCENARIO.robot, intercept=InterceptParams(z_low=2.0, z_high=3.0)))
    found = reachable(Trial.drawn(away, 0), MODEL)
    assert found.swing is None and found.index is None
