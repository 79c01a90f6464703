"""What a relaxed goal gives up is named, is enough, and is hardly more than needed."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from racket.test_stroke import balls
from tt_core.errors import BadChoice, TtError
from tt_core.physics import Physics
from tt_core.states import BallState, ReturnGoal
from tt_racket.failures import StrokeFailure
from tt_racket.goal_relaxation import AS_ASKED, GoalPart, RelaxationParams, Return, relax_goal, relax_part
from tt_racket.stroke import solve

PHYSICS = Physics.liu()
BALL = BallState(0.0, [-0.15, 0.7, 0.25], [-2.5, 0, 0.1], [0, 150, 0])
goals = st.builds(
    lambda x, y, t, wy, wz: ReturnGoal([x, y], t, wy, wz),
    st.floats(1.4, 2.7),
    st.floats(0.05, 1.45),
    st.floats(0.2, 0.8),
    *[st.floats(-600, 600)] * 2,
)


PARTS = {"spin": GoalPart.SPIN, "time": GoalPart.TIME, "place": GoalPart.PLACE}


def relaxed_alone(ball, goal, racket_speed=math.inf):
    """The nearest feasible return for each part that makes the goal feasible alone."""
    found = {part: relax_part(part, ball, goal, PHYSICS, RelaxationParams(), racket_speed) for part in PARTS}
    return {part: one for part, one in found.items() if one is not None}


@settings(max_examples=40)
@given(balls, goals)
def test_a_relaxed_goal_is_feasible_and_changes_only_what_it_names(ball, goal):
    for part, relaxed in relaxed_alone(ball, goal, racket_speed=5.0).items():
        stroke, relaxation = relaxed.stroke, relaxed.relaxation
        assert stroke.racket is not None and np.linalg.norm(stroke.racket.velocity) <= 5.0
        assert solve(ball, relaxed.goal, PHYSICS).reason is None
        assert relaxation.parts is PARTS[part]
        changed = {"spin": relaxation.spin, "time": relaxation.time, "place": relaxation.place}
        assert {name for name, amount in changed.items() if amount != 0.0} == {part}
        assert relaxation.spin == pytest.approx(math.dist((relaxed.goal.spin_y, relaxed.goal.spin_z), (goal.spin_y, goal.spin_z)))
        assert relaxed.goal.flight_time == pytest.approx(goal.flight_time + relaxation.time)
        assert relaxation.place == pytest.approx(math.dist(relaxed.goal.landing, goal.landing))


@settings(max_examples=40)
@given(balls, goals)
def test_the_order_decides_what_is_given_up(ball, goal):
    asked = Return(ball, goal, solve(ball, goal, PHYSICS))
    alone = relaxed_alone(ball, goal)
    for order in (("spin", "time", "place"), ("place", "spin"), ("time",)):
        relaxed = relax_goal(asked, PHYSICS, RelaxationParams(order=order))
        first = next((name for name in order if name in alone), None)
        if asked.stroke.racket:
            assert relaxed.relaxation == AS_ASKED
        elif first is not None:
            assert relaxed.relaxation.parts is PARTS[first] and relaxed.relaxation.rank(order) == order.index(first)
        elif relaxed.stroke.reason is None:
            assert GoalPart.SPIN in relaxed.relaxation.parts and len(relaxed.relaxation.parts) == 2
            assert relaxed.relaxation.rank(order) >= len(order)


def test_as_much_spin_is_kept_as_the_rubber_gives():
    goal = ReturnGoal([2.0, 0.7], 0.6, 1900, 0)
    ((part, relaxed),) = relaxed_alone(BALL, goal).items()
    assert part == "spin" and relaxed.stroke.share == pytest.approx(1.0, abs=0.02)
    assert relaxed.relaxation.spin == pytest.approx(math.hypot(1900 - relaxed.goal.spin_y, relaxed.goal.spin_z))


def test_the_time_is_as_near_as_the_net_lets_it():
    goal = ReturnGoal([2.0, 0.7], 0.25, 0, 0)
    relaxed = relax_goal(Return(BALL, goal, solve(BALL, goal, PHYSICS)), PHYSICS, RelaxationParams(order=("time",)))
    assert relaxed.relaxation.parts is GoalPart.TIME and relaxed.relaxation.time == pytest.approx(relaxed.goal.flight_time - 0.25)
    shorter = ReturnGoal([2.0, 0.7], relaxed.goal.flight_time - 0.004, 0, 0)
    assert solve(BALL, shorter, PHYSICS).reason.code is StrokeFailure.NET


def test_a_slow_racket_is_told_by_how_much_and_the_goal_is_relaxed():
    goal = ReturnGoal([2.055, 0.7625], 0.6, -100, 0)
    fast = solve(BALL, goal, PHYSICS)
    slow = solve(BALL, goal, PHYSICS, racket_speed=2.0)
    assert slow.missing == pytest.approx(np.linalg.norm(fast.racket.velocity) - 2.0)
    assert slow.reason.code is StrokeFailure.RACKET_TOO_FAST and slow.reason.values["bound"] == 2.0
    assert slow.reason.values["speed"] == pytest.approx(np.linalg.norm(fast.racket.velocity))
    relaxed = relax_goal(Return(BALL, goal, slow), PHYSICS, racket_speed=2.0)
    assert relaxed.relaxation != AS_ASKED and np.linalg.norm(relaxed.stroke.racket.velocity) <= 2.0


def test_what_nothing_helps_stays_as_asked_with_the_reason():
    away = BallState(0.0, [-0.15, 0.7, 0.25], [2.5, 0, 0.1], [0, 150, 0])
    goal = ReturnGoal([2.0, 0.7], 0.6, 0, 0)
    relaxed = relax_goal(Return(away, goal, solve(away, goal, PHYSICS)), PHYSICS)
    assert relaxed.relaxation == AS_ASKED and relaxed.stroke.reason.code is StrokeFailure.BALL_LEAVES
    assert math.isinf(relaxed.stroke.residual)
    with pytest.raises(BadChoice) as error:
        RelaxationParams(order=("speed",))
    assert (error.value.name, error.value.value) == ("order[0]", "speed")
    with pytest.raises(TtError):
        RelaxationParams(order=("spin", "spin"))
