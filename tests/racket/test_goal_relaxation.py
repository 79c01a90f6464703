"""What is given up is named, is enough, and is hardly more than needed."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from racket.test_stroke import balls
from tt_core.errors import BadChoice
from tt_core.physics import Physics
from tt_core.states import BallState, ReturnGoal
from tt_racket.goal_relaxation import AS_ASKED, RelaxationParams, choices, relax_goal
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


@settings(max_examples=40)
@given(balls, goals)
def test_a_choice_is_feasible_and_changes_only_what_it_names(ball, goal):
    for choice in choices(ball, goal, PHYSICS, racket_speed=5.0):
        stroke = choice.stroke
        assert stroke.racket is not None and np.linalg.norm(stroke.racket.velocity) <= 5.0
        assert solve(ball, choice.goal, PHYSICS).reason is None
        same = {
            "spin": (choice.goal.spin_y, choice.goal.spin_z) == (goal.spin_y, goal.spin_z),
            "time": choice.goal.flight_time == goal.flight_time,
            "place": (choice.goal.landing == goal.landing).all(),
        }
        assert all(same[name] for name in same if name != choice.name)


@settings(max_examples=40)
@given(balls, goals)
def test_the_order_decides_what_is_given_up(ball, goal):
    asked = solve(ball, goal, PHYSICS)
    alone = {choice.name: choice for choice in choices(ball, goal, PHYSICS)}
    for order in (("spin", "time", "place"), ("place", "spin"), ("time",)):
        choice = relax_goal(ball, goal, PHYSICS, RelaxationParams(order=order))
        if asked.racket:
            assert choice.name == AS_ASKED
        else:
            first = next((name for name in order if name in alone), None)
            assert choice.name == first or (first is None and (choice.name.startswith("spin and") or choice.stroke.reason))


def test_as_much_spin_is_kept_as_the_rubber_gives():
    goal = ReturnGoal([2.0, 0.7], 0.6, 1900, 0)
    (choice,) = choices(BALL, goal, PHYSICS)
    assert choice.name == "spin" and choice.stroke.share == pytest.approx(1.0, abs=0.02)
    assert choice.given.startswith(f"{1900 - choice.goal.spin_y:.0f} rad/s to y")


def test_the_time_is_as_near_as_the_net_lets_it():
    choice = relax_goal(BALL, ReturnGoal([2.0, 0.7], 0.25, 0, 0), PHYSICS, RelaxationParams(order=("time",)))
    assert choice.name == "time" and choice.given.endswith(" s")
    shorter = ReturnGoal([2.0, 0.7], choice.goal.flight_time - 0.004, 0, 0)
    assert "hit the net" in solve(BALL, shorter, PHYSICS).reason


def test_a_slow_racket_is_told_by_how_much_and_traded():
    goal = ReturnGoal([2.055, 0.7625], 0.6, -100, 0)
    fast = solve(BALL, goal, PHYSICS)
    slow = solve(BALL, goal, PHYSICS, racket_speed=2.0)
    assert slow.missing == pytest.approx(np.linalg.norm(fast.racket.velocity) - 2.0)
    choice = relax_goal(BALL, goal, PHYSICS, racket_speed=2.0)
    assert choice.name != AS_ASKED and np.linalg.norm(choice.stroke.racket.velocity) <= 2.0


def test_what_nothing_helps_stays_as_asked_with_the_reason():
    away = BallState(0.0, [-0.15, 0.7, 0.25], [2.5, 0, 0.1], [0, 150, 0])
    choice = relax_goal(away, ReturnGoal([2.0, 0.7], 0.6, 0, 0), PHYSICS)
    assert choice.name == AS_ASKED and "does not come" in choice.stroke.reason and math.isinf(choice.stroke.residual)
    with pytest.raises(BadChoice):
        RelaxationParams(order=("speed",))
