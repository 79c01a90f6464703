"""A ball near the tape goes on with the probability of a touch."""

import numpy as np
import pytest
from tt_core.constants import NET_HEIGHT, NET_X
from tt_core.path_end import PathEnd
from tt_core.physics import Physics
from tt_core.states import BallState
from tt_predict.net_touch import rollout_past_net
from tt_predict.rollout import StopRule, rollout

PHYSICS, STOP = Physics.measured(), StopRule.at_x(-0.5)
SIGMAS = np.repeat([3e-3, 0.05, 5.0], 3)  # m, m/s, rad/s


def ball(height):
    """A ball whose centre crosses the net at about this height (m) above the tape."""
    start = np.array([2.6, 0.76, 0.4, -6.0, 0.0, 0.0, 0.0, -150.0, 0.0])
    free = rollout(BallState.from_vector(0.0, start + [0, 0, 0.5, 0, 0, 0, 0, 0, 0]), PHYSICS, StopRule.at_x(NET_X)).end.position[2] - 0.5
    start[2] += NET_HEIGHT + height - free
    return BallState.from_vector(0.0, start, np.diag(SIGMAS**2))


def test_the_probability_rises_from_none_to_all_as_the_ball_sinks():
    heights = np.array([0.2, 0.07, 0.03, 0.02, 0.01, -0.05])
    touches = [rollout_past_net(ball(height), PHYSICS, STOP).touch for height in heights]
    assert touches == sorted(touches)
    assert touches[0] == 0.0 and touches[-1] == 1.0
    assert touches[3] == pytest.approx(0.5, abs=0.1)  # its lowest point is level with the tape


def test_a_path_into_the_tape_goes_on_and_one_far_below_ends():
    grazing = rollout_past_net(ball(0.015), PHYSICS, STOP)
    assert rollout(ball(0.015), PHYSICS, STOP).ended is PathEnd.NET
    assert 0.3 < grazing.touch < 0.99 and grazing.path.ended is PathEnd.STOP and len(grazing.path.bounces) == 1
    assert (np.diff(grazing.path.times) >= 0.0).all() and grazing.path.times[0] == 0.0
    passing = rollout(ball(0.03), PHYSICS, STOP)
    # those that pass are a little higher than the mean: within one of its standard deviations, 2 cm at the end
    assert grazing.path.end.position == pytest.approx(passing.end.position, abs=0.06)
    assert rollout_past_net(ball(-0.06), PHYSICS, STOP).path.ended is PathEnd.NET


def test_what_does_not_come_near_the_net_is_left_alone():
    for one in (ball(0.2), BallState(0.0, [1.0, 0.7, 0.3], [-5, 0, 1], [0, 0, 0], np.eye(9) * 1e-6)):
        found, plain = rollout_past_net(one, PHYSICS, STOP), rollout(one, PHYSICS, STOP)
        assert found.touch == 0.0 and found.path.end.vector == pytest.approx(plain.end.vector, abs=0.0)


def test_a_certain_ball_ends_at_the_net():
    one = ball(0.0)
    found = rollout_past_net(BallState.from_vector(0.0, one.vector), PHYSICS, STOP)
    assert found.touch == 1.0 and found.path.ended is PathEnd.NET
