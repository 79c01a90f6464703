"""What the solver says, the models do: solve, then hit and fly, lands on the goal."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from tt_core.constants import NET_HEIGHT
from tt_core.errors import BadChoice, NotFinite, OutOfRange
from tt_core.flight import fly
from tt_core.physics import Physics
from tt_core.states import BallState, ReturnGoal
from tt_racket.failures import StrokeFailure
from tt_racket.stroke import solve

balls = st.builds(
    lambda x, y, z, vx, vy, vz, wx, wy, wz: BallState(2.0, [x, y, z], [vx, vy, vz], [wx, wy, wz]),
    st.floats(-0.3, 0.0),
    st.floats(0.3, 1.2),
    st.floats(0.15, 0.5),
    st.floats(-6, -2.5),
    st.floats(-0.8, 0.8),
    st.floats(-1, 1),
    *[st.floats(-400, 400)] * 3,
)
goals = st.builds(
    lambda x, y, t, wy, wz: ReturnGoal([x, y], t, wy, wz),
    st.floats(1.6, 2.6),
    st.floats(0.2, 1.3),
    st.floats(0.45, 0.8),
    *[st.floats(-150, 150)] * 2,
)


def swings(ball, duration, physics):
    """Whether spin comes to lie along the flight, where (3.3) jumps: the landing is then exact to 1e-4 m only."""
    states = [fly(ball.vector, t, physics.air.coefficients) for t in np.linspace(0.0, duration, 30)]
    across = [np.hypot(s[3] * s[7] - s[4] * s[6], np.hypot(s[3], s[4]) * s[8]) / np.linalg.norm(s[6:]) for s in states if s[6:].any()]
    return min(across, default=1.0) < 0.3


@pytest.mark.parametrize("physics", [Physics.liu(), Physics.measured(), Physics.liu(0.0)])
@given(balls, goals)
def test_a_solved_stroke_lands_on_the_goal(physics, ball, goal):
    stroke = solve(ball, goal, physics)
    if stroke.reason:
        return
    assume(not swings(stroke.ball_after, goal.flight_time, physics))
    velocity, spin = physics.racket.after(ball.velocity, ball.spin, stroke.racket)
    end = fly(np.concatenate([ball.position, velocity, spin]), goal.flight_time, physics.air.coefficients)
    # 1e-6 m: the asked exactness; the inverse loses digits where |eta| comes near |xi|
    assert end[:3] == pytest.approx([*goal.landing, physics.contact_height], abs=1e-6)
    assert spin[1:] == pytest.approx([goal.spin_y, goal.spin_z], abs=1e-5)
    assert stroke.racket.time == ball.time
    assert stroke.racket.position + physics.contact_height * stroke.racket.normal == pytest.approx(ball.position, abs=1e-9)


@given(balls, goals)
def test_a_mirror_image_is_hit_mirrored(ball, goal):
    flip = BallState(ball.time, ball.position * [1, -1, 1] + [0, 1.525, 0], ball.velocity * [1, -1, 1], ball.spin * [-1, 1, -1])
    one = solve(ball, goal, Physics.liu())
    other = solve(flip, ReturnGoal([goal.landing[0], 1.525 - goal.landing[1]], goal.flight_time, goal.spin_y, -goal.spin_z), Physics.liu())
    assert (one.reason is None) == (other.reason is None)
    if one.racket:
        assert other.racket.velocity * [1, -1, 1] == pytest.approx(one.racket.velocity, abs=1e-5)
        assert other.racket.normal * [1, -1, 1] == pytest.approx(one.racket.normal, abs=1e-5)


BALL = BallState(0.0, [-0.15, 0.7, 0.25], [-2.5, 0, 0.1], [0, 150, 0])
GOAL = ReturnGoal([2.055, 0.7625], 0.6, -100, 0)


def test_fewer_corrections_are_coarser():
    residuals = [solve(BALL, GOAL, Physics.liu(), corrections=n).residual for n in (0, 1, 2, 4, 8)]
    assert residuals == sorted(residuals, reverse=True)
    assert residuals[0] == solve(BALL, GOAL, Physics.liu(), method="sam").residual


@pytest.mark.parametrize(
    ("ball", "goal", "code", "values"),
    [
        (BALL, ReturnGoal([1.0, 0.7], 0.6, 0, 0), StrokeFailure.LANDING_ASIDE, {"x": 1.0, "y": 0.7, "beside": 0.37}),
        (BALL, ReturnGoal([2.0, 2.7], 0.6, 0, 0), StrokeFailure.LANDING_ASIDE, {"x": 2.0, "y": 2.7, "beside": 1.175}),
        (BALL, ReturnGoal([2.0, 0.7], 0.6, 1900, 0), StrokeFailure.TOO_MUCH_SPIN, {}),
        (BALL, ReturnGoal([2.0, 0.7], 0.2, 0, 0), StrokeFailure.NET, {}),
        (BallState(0.0, [-0.15, 1.8, 0.25], [-2.5, 0, 0.1], [0, 0, 0]), ReturnGoal([2.6, 1.5], 0.6, 0, 0), StrokeFailure.SIDEWAYS, {}),
        (BallState(0.0, [-0.15, 0.7, 0.25], [0, 0, 0], [0, 0, 0]), GOAL, StrokeFailure.BALL_LEAVES, {"v_x": 0.0}),
        (BALL, ReturnGoal([2.0, 0.7], 0.03, 0, 0), StrokeFailure.NO_SOLUTION, {"flight_time": 0.03}),
        (BallState(0.0, [-0.15, 0.7, 0.25], [2.5, 0, 0], [0, 0, 0]), GOAL, StrokeFailure.BALL_LEAVES, {"v_x": 2.5}),
        (BallState(0.0, [1.5, 0.7, 0.25], [-2.5, 0, 0], [0, 0, 0]), GOAL, StrokeFailure.BALL_BEYOND_NET, {"x": 1.5}),
    ],
)
def test_what_cannot_be_is_a_reason(ball, goal, code, values):
    stroke = solve(ball, goal, Physics.liu())
    assert stroke.reason.code is code
    assert {name: stroke.reason.values[name] for name in values} == pytest.approx(values)
    assert str(stroke.reason)  # all numbers of its sentence are there
    assert stroke.racket is None and stroke.ball_after is None


def test_a_return_clears_the_net():
    stroke = solve(BALL, GOAL, Physics.liu())
    heights = [fly(stroke.ball_after.vector, t, Physics.liu().air.coefficients) for t in np.linspace(0, 0.6, 601)]
    over = min(heights, key=lambda s: abs(s[0] - 1.37))
    assert over[2] > NET_HEIGHT + 0.02


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: ReturnGoal([2.0, 0.7], 0.0, 0, 0), "flight_time"),
        (lambda: ReturnGoal([2.0, np.nan], 0.6, 0, 0), "landing"),
        (lambda: ReturnGoal([2.0, 0.7], 0.6, np.inf, 0), "spin_y"),
        (lambda: ReturnGoal.from_vector(np.array([2.0, 0.7, 0.6, 0.0, 2001.0])), "spin_z"),
        (lambda: BallState(0.0, [0, 0, 0], [np.nan, 0, 0], [0, 0, 0]), "velocity"),
    ],
)
def test_bad_input_names_itself(make, name):
    with pytest.raises((OutOfRange, NotFinite)) as error:
        make()
    assert error.value.name == name


def test_what_is_missing_is_a_number():
    fast, far = ReturnGoal([2.0, 0.7], 0.6, 1900, 0), ReturnGoal([1.0, 0.7], 0.6, 0, 0)
    assert solve(BALL, fast, Physics.liu()).missing == pytest.approx(solve(BALL, fast, Physics.liu()).share - 1.0)
    assert solve(BALL, far, Physics.liu()).missing == pytest.approx(0.37)  # m, to the net
    assert solve(BALL, GOAL, Physics.liu()).missing == 0.0 < solve(BALL, GOAL, Physics.liu()).share < 1.0


def test_an_unknown_method_names_itself():
    with pytest.raises(BadChoice) as error:
        solve(BALL, GOAL, Physics.liu(), method="newton")
    assert (error.value.name, error.value.value, error.value.choices) == ("method", "newton", ("exact", "sam"))
