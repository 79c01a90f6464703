"""Candidates lie on the path, in the window, best first."""

from dataclasses import asdict

import numpy as np
import pytest
from tt_core.errors import BadChoice, OutOfRange
from tt_core.flight import fly
from tt_core.hit_windows import HIT_WINDOWS, PATH_END_X, path_end
from tt_core.physics import Physics
from tt_core.states import BallPath, BallState, Bounce, ReturnGoal
from tt_racket.failures import StrokeFailure
from tt_racket.goal import GoalParams, default_goal
from tt_racket.goal_relaxation import AS_ASKED, GoalPart, RelaxationParams
from tt_racket.intercept import InterceptParams, intercept
from tt_racket.sensitivity import StrikeErrorParams, landing_rms

PHYSICS = Physics.liu()


def path_after_bounce():
    """A ball that bounces at 0.3 s at x = 0.6 and flies on."""
    before = BallState(0.3, [0.6, 0.76, 0.02], [-4.5, 0, -3.0], [0, 250, 0])
    velocity, spin = PHYSICS.table.after(before.velocity, before.spin)
    after = BallState(0.3, before.position, velocity, spin)
    times = np.arange(0, 0.4, 0.02)
    rows = np.array([before.vector] + [fly(after.vector, t, PHYSICS.air.coefficients) for t in times])
    return BallPath(np.append(0.3, times + 0.3), rows[:, :3], rows[:, 3:6], rows[:, 6:], (Bounce(before, after),))


def test_candidates_are_on_the_path_in_the_window_and_ordered_by_racket_speed_and_sensitivity():
    path, params, goal = path_after_bounce(), InterceptParams(), default_goal(np.array([0.0, 250.0, 0.0]), GoalParams())
    found = intercept(path, goal, PHYSICS, params)
    assert len(found.strokes) > 3 and set(found.relaxed) == {AS_ASKED}
    costs = [
        np.linalg.norm(s.racket.velocity) / params.racket_speed
        + landing_rms(path.at(s.racket.time), s, goal.flight_time, PHYSICS, StrikeErrorParams()) / params.landing_rms
        for s in found.strokes
    ]
    assert costs == sorted(costs)
    by_speed = intercept(path, goal, PHYSICS, InterceptParams(landing_rms=1e3))
    speeds = [np.linalg.norm(s.racket.velocity) for s in by_speed.strokes]
    assert speeds == pytest.approx(sorted(speeds), abs=1e-2)
    for stroke in found.strokes:
        ball = path.at(stroke.racket.time).position
        assert params.x_low <= ball[0] <= params.x_high
        assert stroke.racket.position + PHYSICS.contact_height * stroke.racket.normal == pytest.approx(ball, abs=1e-9)


def test_the_reachable_window_holds_the_near_one_and_more():
    path, goal = path_after_bounce(), default_goal(np.array([0.0, 250.0, 0.0]), GoalParams())
    near, reachable = (
        {s.racket.time for s in intercept(path, goal, PHYSICS, InterceptParams.window(name)).strokes} for name in ("near", "reachable")
    )
    assert near < reachable
    with pytest.raises(BadChoice) as error:
        InterceptParams.window("far")
    assert (error.value.name, error.value.value, error.value.choices) == ("window", "far", ("near", "reachable"))


def test_paths_go_past_every_hit_window():
    assert path_end(InterceptParams().x_low) == -0.5
    assert min(window.x_low for window in HIT_WINDOWS.values()) > PATH_END_X
    for title, window in HIT_WINDOWS.items():
        params = InterceptParams.window(title)
        assert {name: getattr(params, name) for name in asdict(window)} == asdict(window)


def test_too_fast_a_racket_is_refused_with_the_number():
    path = path_after_bounce()
    found = intercept(path, default_goal(path.spins[0], GoalParams()), PHYSICS, InterceptParams(racket_speed=0.2))
    assert not found.strokes
    assert {failure.code for _, failure in found.refused} == {StrokeFailure.RACKET_TOO_FAST} == {found.reason.code}
    assert all(failure.values["speed"] > failure.values["bound"] == 0.2 for _, failure in found.refused)


def test_a_goal_out_of_reach_gives_up_what_the_order_says_and_tells_it():
    path, order = path_after_bounce(), ("spin", "time", "place")
    for time, spin, parts in ((0.6, 900.0, GoalPart.SPIN), (0.25, 150.0, GoalPart.SPIN | GoalPart.TIME)):
        goal = ReturnGoal([2.055, 0.7625], time, spin, 0.0)
        found = intercept(path, goal, PHYSICS, InterceptParams(), RelaxationParams(order=order))
        assert found.strokes and len(found.relaxed) == len(found.strokes)
        assert found.relaxed[0].parts == parts and found.reason is None
        assert all(isinstance(failure.code, StrokeFailure) for _, failure in found.refused)
        assert max(np.linalg.norm(s.racket.velocity) for s in found.strokes) <= InterceptParams().racket_speed


def test_a_volley_is_no_candidate():
    path = path_after_bounce()
    volley = BallPath(path.times[1:], path.positions[1:], path.velocities[1:], path.spins[1:])
    found = intercept(volley, default_goal(path.spins[0], GoalParams()), PHYSICS, InterceptParams())
    assert not found.strokes and found.reason.code is StrokeFailure.NO_HIT_POINT


@pytest.mark.parametrize(
    ("spin", "spin_y", "spin_z"),
    [([0, 250, 20], -125.66, 0), ([0, -250, 20], 104.72, 0), ([10, -50, 150], 0, -100), ([10, 50, -150], 0, 100)],
)
def test_spin_is_answered_by_its_kind(spin, spin_y, spin_z):
    goal = default_goal(np.array(spin, float), GoalParams())
    assert (goal.spin_y, goal.spin_z) == (spin_y, spin_z)


def test_bad_values_name_themselves():
    with pytest.raises(OutOfRange) as error:
        InterceptParams(x_low=1.0)
    assert (error.value.name, error.value.value, error.value.high) == ("x_low", 1.0, 0.0)
    with pytest.raises(OutOfRange) as error:
        GoalParams(landing_x=1.0)
    assert (error.value.name, error.value.value) == ("landing_x", 1.0)
