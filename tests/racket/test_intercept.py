"""Candidates lie on the path, in the window, best first."""

import numpy as np
import pytest
from tt_core.flight import fly
from tt_core.physics import Physics
from tt_core.states import BallPath, BallState, Bounce
from tt_racket.goal import GoalParams, answer
from tt_racket.intercept import InterceptParams, intercept

PHYSICS = Physics.liu()


def path_after_bounce():
    """A ball that bounces at 0.3 s at x = 0.6 and flies on."""
    before = BallState(0.3, [0.6, 0.76, 0.02], [-4.5, 0, -3.0], [0, 250, 0])
    velocity, spin = PHYSICS.table.after(before.velocity, before.spin)
    after = BallState(0.3, before.position, velocity, spin)
    times = np.arange(0, 0.4, 0.02)
    rows = np.array([before.vector] + [fly(after.vector, t, PHYSICS.air.coefficients) for t in times])
    return BallPath(np.append(0.3, times + 0.3), rows[:, :3], rows[:, 3:6], rows[:, 6:], (Bounce(before, after),))


def test_candidates_are_on_the_path_in_the_window_and_ordered_by_racket_speed():
    path, params = path_after_bounce(), InterceptParams()
    found = intercept(path, answer(path.spins[0], GoalParams()), PHYSICS, params)
    assert len(found.strokes) > 3
    speeds = [np.linalg.norm(s.racket.velocity) for s in found.strokes]
    assert speeds == sorted(speeds)
    for stroke in found.strokes:
        ball = path.at(stroke.racket.time).position
        assert params.x_low <= ball[0] <= params.x_high
        assert stroke.racket.position + PHYSICS.contact_height * stroke.racket.normal == pytest.approx(ball, abs=1e-9)


def test_too_fast_a_racket_is_refused_with_the_number():
    path = path_after_bounce()
    found = intercept(path, answer(path.spins[0], GoalParams()), PHYSICS, InterceptParams(racket_speed=0.2))
    assert not found.strokes
    assert all("m/s is over 0.2 m/s" in reason for _, reason in found.refused)


def test_a_volley_is_no_candidate():
    path = path_after_bounce()
    volley = BallPath(path.times[1:], path.positions[1:], path.velocities[1:], path.spins[1:])
    assert not intercept(volley, answer(path.spins[0], GoalParams()), PHYSICS, InterceptParams()).strokes


@pytest.mark.parametrize(
    ("spin", "spin_y", "spin_z"),
    [([0, 250, 20], -125.66, 0), ([0, -250, 20], 104.72, 0), ([10, -50, 150], 0, -100), ([10, 50, -150], 0, 100)],
)
def test_spin_is_answered_by_its_kind(spin, spin_y, spin_z):
    goal = answer(np.array(spin, float), GoalParams())
    assert (goal.spin_y, goal.spin_z) == (spin_y, spin_z)


def test_bad_values_name_themselves():
    with pytest.raises(ValueError, match="x_low = 1 is outside"):
        InterceptParams(x_low=1.0)
    with pytest.raises(ValueError, match="landing_x = 1 is outside"):
        GoalParams(landing_x=1.0)
