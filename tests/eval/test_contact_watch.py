"""The contact of racket and ball is found when both sides of the face, the rim and their speeds say so."""

import numpy as np
import pytest
from tt_arm.joints import Joints
from tt_arm.model import ArmModel
from tt_core.constants import BALL_RADIUS, RACKET_RADIUS
from tt_core.states import BallState, RacketState
from tt_eval.contact_watch import is_near, racket_of, time_to_contact

RACKET = RacketState.facing(1.0, [-0.3, 0.7, 0.3], [1.0, 0.0, 0.0], np.array([1.0, 0.0, 0.0]))


def ball(offset, velocity=(-4.0, 0.0, 0.0), time=1.0):
    return BallState(time, RACKET.position + offset, velocity, [0, 0, 0])


@pytest.mark.parametrize("distance", [0.1, 0.0, -0.01])
def test_the_time_is_the_gap_over_the_speed(distance):
    for side in (1.0, -1.0):  # of the face
        towards = [-4.0, 0, 0] if side > 0 else [6.0, 0, 0]
        found = time_to_contact(RACKET, ball([side * (BALL_RADIUS + distance), 0.0, 0.0], towards))
        assert found == pytest.approx(distance / 5.0)


def test_a_ball_beside_or_on_its_way_is_not_met():
    assert time_to_contact(RACKET, ball([0.1, RACKET_RADIUS + 0.05, 0.0])) == np.inf
    assert time_to_contact(RACKET, ball([0.1, 0.0, 0.0], RACKET.velocity)) == np.inf


def test_only_a_near_ball_is_looked_at():
    assert is_near(RACKET, ball([0.2, 0.0, 0.0])) and not is_near(RACKET, ball([1.0, 0.0, 0.0]))
    assert is_near(RACKET, ball([1.0, 0.0, 0.0], time=0.8))  # 0.2 s at 4 m/s


def test_the_racket_is_that_of_the_arm():
    model, rng = ArmModel.pa10(), np.random.default_rng(0)
    q, qdot = np.array(model.waiting), rng.normal(size=7)
    met = racket_of(model, Joints(2.0, q, qdot))
    position, rotation = model.racket(q)
    assert met.racket.time == 2.0 and met.racket.position == pytest.approx(position)
    assert met.racket.normal == pytest.approx(rotation[:, 2])
    after = model.racket(q + 1e-6 * qdot)
    assert met.racket.velocity == pytest.approx((after[0] - position) / 1e-6, abs=1e-4)
    assert np.cross(met.turning, rotation[:, 2]) == pytest.approx((after[1][:, 2] - rotation[:, 2]) / 1e-6, abs=1e-4)
