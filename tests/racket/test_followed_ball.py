"""A ball keeps its goal while it is followed, and strokes go on after its bounce."""

from dataclasses import replace

import numpy as np
import pytest
from tt_core.physics import Physics
from tt_core.ros.convert import strokes_to_message
from tt_core.states import BallPath, BallState, ReturnGoal
from tt_predict.rollout import StopRule, rollout
from tt_racket.followed_ball import FollowedBall
from tt_racket.goal import GoalParams
from tt_racket.goal_relaxation import GoalPart
from tt_racket.intercept import InterceptParams, hit_points, intercept

PHYSICS = Physics.measured()
START = BallState(0.0, [2.6, 0.76, 0.34], [-5.5, 0.0, 1.2], [0, -200, 0])


def path_from(time, spin=None):
    """The path of the same ball from `time` (s) on."""
    ball = START if time == 0.0 else rollout(START, PHYSICS, StopRule.at_time(time)).end
    if spin is not None:
        ball = BallState(ball.time, ball.position, ball.velocity, spin)
    return rollout(ball, PHYSICS, StopRule.at_x(-0.5))


def test_the_goal_stays_once_the_spin_is_settled():
    ball, params = FollowedBall(), GoalParams()
    first = ball.follow(path_from(0.0, [0, 50, 0]), params)
    assert first.spin_y == params.back_spin_y
    assert ball.follow(path_from(0.05), params).spin_y == params.top_spin_y
    assert ball.follow(path_from(0.15), params).spin_y == params.top_spin_y
    assert ball.follow(path_from(0.20, [0, 50, 0]), params).spin_y == params.top_spin_y
    asked = ReturnGoal([2.0, 0.7], 0.5, 0.0, 0.0)
    assert ball.follow(path_from(0.25), params, asked) is asked


def test_strokes_go_on_after_the_bounce_at_the_same_times():
    ball, params, window = FollowedBall(), GoalParams(), InterceptParams.window("reachable")
    bounce = path_from(0.0).bounces[0].time
    goal = ball.follow(path_from(bounce - 0.05), params)
    assert not ball.bounced
    before = intercept(path_from(bounce - 0.05), goal, PHYSICS, window, bounced=ball.bounced)
    after_path = path_from(bounce + 0.05)
    goal = ball.follow(after_path, params)
    assert ball.bounced and not after_path.bounces
    after = intercept(after_path, goal, PHYSICS, window, bounced=ball.bounced)
    strokes = {round(s.racket.time, 6): s.racket for s in before.strokes}
    assert strokes and {round(s.racket.time, 6) for s in after.strokes} == set(strokes)
    for stroke in after.strokes:
        assert stroke.racket.position == pytest.approx(strokes[round(stroke.racket.time, 6)].position, abs=1e-5)  # interpolated paths


def test_a_ball_that_will_not_bounce_is_not_hit():
    high = rollout(BallState(0.0, [2.6, 0.76, 1.0], [-9.0, 0.0, 2.0], [0, 0, 0]), PHYSICS, StopRule.at_x(-0.5))
    ball = FollowedBall()
    ball.follow(high, GoalParams())
    assert not high.bounces and not ball.bounced
    assert hit_points(high, InterceptParams(), ball.bounced) == []


def test_another_ball_has_its_own_goal_and_bounce():
    ball, params = FollowedBall(), GoalParams()
    ball.follow(path_from(0.0), params)
    late = path_from(path_from(0.0).bounces[0].time + 0.05)
    ball.follow(late, params)
    assert ball.bounced
    shifted = path_from(0.0, [0, 200, 0])
    other = BallPath(
        shifted.times + late.times[0] + 0.1, shifted.positions, shifted.velocities, shifted.spins, shifted.bounces, shifted.ended
    )
    assert ball.follow(other, params).spin_y == params.back_spin_y
    assert not ball.bounced


def test_other_flight_times_come_after_the_strokes_as_asked():
    path, params = path_from(0.0), GoalParams()
    goal = FollowedBall().follow(path, params)
    plain = intercept(path, goal, PHYSICS, InterceptParams())
    more = intercept(path, goal, PHYSICS, InterceptParams(fallback_time=-0.1, as_asked=3))
    assert len(more.strokes) > len(plain.strokes)
    times = [one.time for one in more.relaxed]
    assert times[:3] == [0.0] * 3 and times[3] == times[4] == pytest.approx(-0.1)
    fallback = [one for one in more.relaxed if one.time]
    assert {one.parts for one in fallback} == {GoalPart.TIME, GoalPart.TIME | GoalPart.SPIN}
    for asked, stroke in zip(plain.strokes[:3], more.strokes[:3], strict=True):
        assert np.allclose(asked.racket.position, stroke.racket.position)


def test_no_more_strokes_are_offered_than_a_message_holds():
    path = path_from(0.0)
    goal = FollowedBall().follow(path, GoalParams())
    found = intercept(path, goal, PHYSICS, replace(InterceptParams.window("reachable"), spacing=0.0028, fallback_time=-0.1))
    assert len(found.strokes) == 64 == len(found.relaxed)
    strokes_to_message([stroke.racket for stroke in found.strokes], path.times[0])
