"""Paths stop where they should, to rounding error, and bounce as the models say."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from tt_core.constants import BALL_RADIUS, FLOOR_Z, NET_HEIGHT, NET_X
from tt_core.errors import BadChoice, NotFinite, OutOfRange
from tt_core.events import LARGEST_COORDINATE
from tt_core.flight import Aerodynamics, fly
from tt_core.path_end import PathEnd
from tt_core.physics import Physics
from tt_core.states import BallState
from tt_predict.rollout import MOST_POINTS, StopRule, rollout, thinned

AIRLESS = Aerodynamics.gravity_only()
PHYSICS = [Physics.liu(), Physics.measured(), Physics.liu(0.0)]
balls = st.builds(
    lambda vx, vy, vz, wx, wy, wz, y: BallState(0.0, [2.6, y, 0.3], [vx, vy, vz], [wx, wy, wz]),
    st.floats(-8, -4),
    st.floats(-0.3, 0.3),
    st.floats(-1, 3),
    st.floats(-100, 100),
    st.floats(-400, 400),
    st.floats(-400, 400),
    st.floats(0.5, 1.0),
)


@pytest.mark.parametrize("physics", PHYSICS)
@given(balls)
def test_a_bounce_is_where_the_ball_touches_and_does_what_the_table_does(physics, ball):
    path = rollout(ball, physics, StopRule.at_x(-0.5))
    for bounce in path.bounces:
        assert bounce.before.position[2] == pytest.approx(physics.contact_height, abs=1e-12)
        velocity, spin = physics.table.after(bounce.before.velocity, bounce.before.spin)
        assert bounce.after.velocity == pytest.approx(velocity)
        assert bounce.after.spin == pytest.approx(spin)


@pytest.mark.parametrize("physics", PHYSICS)
@given(balls)
def test_a_mirror_image_takes_the_mirrored_path(physics, ball):
    one = rollout(ball, physics, StopRule.at_x(-0.2))
    turned = BallState(0.0, ball.position * [1, -1, 1] + [0, 1.525, 0], ball.velocity * [1, -1, 1], ball.spin * [-1, 1, -1])
    other = rollout(turned, physics, StopRule.at_x(-0.2))
    assert one.times == pytest.approx(other.times, abs=1e-9)
    assert other.positions * [1, -1, 1] + [0, 1.525, 0] == pytest.approx(one.positions, abs=1e-8)


@given(balls)
def test_the_path_is_the_flight_up_to_the_bounce(ball):
    assume(np.hypot(*ball.spin[1:]) > 20.0)  # spin along the flight alone: (3.3) jumps, and no step order holds across a jump
    physics = Physics.liu()
    path = rollout(ball, physics, StopRule.at_landing())
    assert not path.bounces
    # 1e-10 m and m/s: the order of the integrator's own error, the steps being cut at another place
    assert path.end.vector == pytest.approx(fly(ball.vector, path.end.time, physics.air.coefficients), abs=1e-9)
    if path.ended is PathEnd.STOP:
        assert path.end.position[2] == pytest.approx(physics.contact_height, abs=1e-12)


def test_stop_rules_stop_where_they_say():
    ball, physics = BallState(1.0, [2.6, 0.76, 0.3], [-5.0, 0.0, 2.0], [0, -300, 0]), Physics.liu()
    assert rollout(ball, physics, StopRule.at_time(1.25)).end.time == pytest.approx(1.25, abs=1e-15)
    assert rollout(ball, physics, StopRule.at_x(0.1)).end.position[0] == pytest.approx(0.1, abs=1e-12)
    assert rollout(ball, physics, StopRule.at_time(1.0)).end.vector == pytest.approx(ball.vector)
    assert rollout(ball, physics, StopRule.at_x(9.0)).ended is PathEnd.FLOOR


@pytest.mark.parametrize(
    ("velocity", "spin", "where"),
    [
        ([-6.22, 0, 1.07], [0, -360, 0], "at the top of the bounce in the window"),
        ([-5.05, 0.3, 2.0], [0, 0, 285], "at the top of the bounce in the window"),
        ([-4.99, 0, 2.53], [0, -300, 0], "still rising at -0.3"),
        ([-4.0, 0, 2.5], [0, 0, 0], "falling already at 0"),
    ],
)
def test_the_dissertations_rule(velocity, spin, where):
    end = rollout(BallState(0.0, [2.62, 0.76, 0.27], velocity, spin), Physics.liu(), StopRule.liu()).end
    assert {
        "at the top of the bounce in the window": -0.3 < end.position[0] < 0 and abs(end.velocity[2]) < 1e-9,
        "still rising at -0.3": abs(end.position[0] + 0.3) < 1e-9 and end.velocity[2] > 0,
        "falling already at 0": abs(end.position[0]) < 1e-9 and end.velocity[2] <= 0,
    }[where]


def test_a_ball_beside_the_table_falls_to_the_floor():
    path = rollout(BallState(0.0, [1.0, -0.5, 0.3], [0, 0, 0], [0, 0, 0]), Physics.liu(), StopRule.at_x(-1.0))
    assert (path.ended, path.bounces) == (PathEnd.FLOOR, ())
    assert path.end.position[2] == pytest.approx(FLOOR_Z + BALL_RADIUS, abs=1e-12)


def height_at(ball, physics, x):
    path = rollout(ball, physics, StopRule.at_x(x))
    return path.ended, path.end.position[2]


@given(balls)
def test_the_net_ends_the_path_of_a_ball_that_does_not_clear_it(ball):
    physics = Physics.liu()
    path = rollout(ball, physics, StopRule.at_x(1.2))
    if path.ended is PathEnd.NET:
        x, _, z = path.end.position
        face = abs(x - NET_X - BALL_RADIUS) < 1e-12 and 0.0 < z < NET_HEIGHT  # its front meets the net
        tape = abs(x - NET_X) < 1e-12 and NET_HEIGHT - 0.02 < z < NET_HEIGHT + BALL_RADIUS  # or it sinks on the tape
        assert face or tape
    elif path.ended is PathEnd.STOP and not path.bounces:
        assert height_at(ball, physics, NET_X + 1e-9)[1] > NET_HEIGHT


@pytest.mark.parametrize(("y", "ended"), [(-0.1526, PathEnd.STOP), (-0.1524, PathEnd.NET)])
def test_the_net_ends_at_its_posts(y, ended):
    assert rollout(BallState(0.0, [1.5, y, 0.1], [-3.0, 0, 0.3], [0, 0, 0]), Physics.liu(), StopRule.at_x(1.3)).ended == ended


@pytest.mark.parametrize(
    ("x", "ended"), [(-0.0201, PathEnd.FLOOR), (-0.0199, PathEnd.EDGE), (-0.01, PathEnd.EDGE), (0.0001, PathEnd.ROLLING)]
)
def test_a_ball_that_falls_past_the_table_may_touch_its_edge(x, ended):
    path = rollout(BallState(0.0, [x, 0.7, 0.3], [0, 0, 0], [0, 0, 0]), Physics(air=AIRLESS), StopRule.at_x(-2.0))
    assert path.ended in (ended, PathEnd.TOO_LONG if ended is PathEnd.ROLLING else ended)
    if ended is PathEnd.EDGE:  # the ball's surface is on the edge
        assert math.hypot(path.end.position[0], path.end.position[2]) == pytest.approx(BALL_RADIUS, abs=1e-12)


@given(balls)
def test_the_stepped_scheme_comes_near_the_exact_path(ball):
    """Without its events the scheme is exact: RK4 of 1/1200 s; a bounce may come a step late."""
    assume(np.hypot(*ball.spin[1:]) > 20.0)  # spin along the flight alone: (3.3) jumps, see above
    physics = Physics.liu()
    exact, stepped = (rollout(ball, physics, StopRule.at_time(0.55), method=m) for m in ("exact", "liu"))
    assume(exact.ended is stepped.ended is PathEnd.STOP)
    assert np.diff(stepped.times).max() == pytest.approx(1 / 1200)
    if not exact.bounces:
        assert stepped.end.position == pytest.approx(exact.at(stepped.times[-1]).position, abs=1e-7)
    elif abs(exact.bounces[0].time - 0.55) > 2e-3 and len(exact.bounces) == 1 and len(stepped.bounces) == 1:
        late = stepped.bounces[0].time - exact.bounces[0].time
        assert -1e-9 < late < 1 / 1200 + 1e-9
        # m: a step late at most 8 m/s, the vertical velocity turned round
        assert stepped.end.position == pytest.approx(exact.at(stepped.times[-1]).position, abs=0.015)


@given(balls)
def test_no_path_gains_energy(ball):
    physics = Physics.measured()
    path = rollout(ball, physics, StopRule.at_x(-0.5))
    shell = 2 / 3 * BALL_RADIUS**2
    energy = 0.5 * (path.velocities**2).sum(1) + 0.5 * shell * (path.spins**2).sum(1) + physics.air.gravity * path.positions[:, 2]
    assert (np.diff(energy) <= 1e-9).all()


def test_a_ball_left_alone_on_the_table_rolls_out():
    path = rollout(BallState(0.0, [1.0, 0.7, 0.03], [0, 0, 0], [0, 0, 0]), Physics.liu(), StopRule.at_x(-1.0))
    assert path.ended in (PathEnd.ROLLING, PathEnd.TOO_LONG)
    assert path.end.position[2] >= 0.02 - 1e-12


@given(st.floats(0.0, 0.4))
def test_a_path_may_be_cut_anywhere(time):
    """Rolling on from a point of the path gives the rest of the path: nothing depends on where the steps lie."""
    ball, physics = BallState(0.0, [2.6, 0.76, 0.3], [-6.5, 0.1, 1.0], [30, -300, 50]), Physics.measured()
    whole = rollout(ball, physics, StopRule.at_x(-0.3))
    assume(abs(time - whole.bounces[0].time) > 1e-6)
    first = rollout(ball, physics, StopRule.at_time(time)).end
    assert rollout(first, physics, StopRule.at_x(-0.3)).end.vector == pytest.approx(whole.end.vector, abs=1e-7)


def test_bad_values_name_themselves():
    ball = BallState(1.0, [2.6, 0.76, 0.3], [-5.0, 0.0, 2.0], [0, -300, 0])
    with pytest.raises(OutOfRange) as error:
        rollout(ball, Physics.liu(), StopRule.at_time(0.5))
    assert (error.value.value, error.value.low) == (-0.5, 0.0)
    with pytest.raises(BadChoice) as error:
        rollout(ball, Physics.liu(), StopRule.at_landing(), method="euler")
    assert (error.value.name, error.value.value, error.value.choices) == ("method", "euler", ("exact", "liu"))
    with pytest.raises(NotFinite) as error:
        StopRule.at_x(math.nan)
    assert error.value.name == "x"


def test_an_end_is_its_word():
    """Diagnostics publish the word, and whoever compares with it may."""
    assert [str(end) for end in PathEnd] == [end.value for end in PathEnd] == list(PathEnd)


anything = st.one_of(st.floats(-100.0, 100.0), st.sampled_from([0.0, -0.0, 1e-300, 100.0, -100.0, 1e17, -1e300, 1.7e308]))


@given(st.lists(anything, min_size=9, max_size=9), st.sampled_from([StopRule.at_x(-0.5), StopRule.liu(), StopRule.at_landing()]))
@example([2.6, 0.7, 0.3, 1e300, 0.0, 0.0, 0.0, 0.0, 0.0], StopRule.at_x(-0.5))
@example([2.6, 0.7, 0.3, -5.0, 0.0, 1.0, 0.0, 1e300, 0.0], StopRule.at_x(-0.5))
def test_whatever_the_state_the_path_is_finite_and_bounded(vector, stop):
    for physics, method in itertools.product(PHYSICS, ("exact", "liu")):
        path = rollout(BallState.from_vector(0.0, np.array(vector)), physics, stop, method=method)
        assert len(path.times) < 30_000
        assert np.isfinite(path.positions).all() and np.isfinite(path.velocities).all() and np.isfinite(path.spins).all()
        assert (np.abs(path.positions[1:]) <= LARGEST_COORDINATE).all()
        few = thinned(path)
        assert len(few.times) <= MOST_POINTS


def test_a_thinned_path_is_the_path():
    ball = BallState(0.0, [2.0, 0.7, 0.8], [0.0, 0.0, 0.0], [0.0, 0.0, 300.0])  # falls along its spin: steps of 0.25 ms
    path = rollout(ball, Physics.liu(), StopRule.at_x(-1.0))
    few = thinned(path)
    assert len(path.times) > MOST_POINTS > len(few.times)
    assert few.bounces == path.bounces and few.end.vector == pytest.approx(path.end.vector, abs=0.0)
    assert np.flatnonzero(np.diff(few.times) == 0.0).size == len(path.bounces)
    # m, m/s, rad/s: cubic interpolation of points 5 ms apart, where drag changes by a tenth within a step
    assert few.rows(path.times[:-1])[:, :3] == pytest.approx(path.positions[:-1], abs=1e-6)


@pytest.mark.parametrize("physics", PHYSICS[:2])
@given(balls)
def test_a_published_path_has_half_of_the_points_and_is_the_path(physics, ball):
    path = rollout(ball, physics, StopRule.at_x(-0.5))
    few = thinned(path)
    assert len(few.times) <= len(path.times) / 2 + 2 + 2 * len(path.bounces)
    assert few.bounces == path.bounces and few.end.vector == pytest.approx(path.end.vector, abs=0.0)
    off = np.abs(few.rows(path.times[:-1]) - path.rows(path.times[:-1])).max(axis=0)
    # a third-order polynomial over 40 ms: seen are 1.0e-5 m and 6.4e-4 m/s for launches, and these balls are up to 3 m/s faster
    assert off[:3].max() < 5e-5 and off[3:6].max() < 3e-3
