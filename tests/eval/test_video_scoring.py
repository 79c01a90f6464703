"""The score_from_video sees what became of a ball, from the pixels of two cameras, and how well it sees is known."""

from dataclasses import replace

import numpy as np
import pytest
from tt_core.flight import Aerodynamics
from tt_core.states import BallState
from tt_eval.episode import play
from tt_eval.miss import Miss
from tt_eval.scenario import Robot, Scenario, load
from tt_eval.video_scoring import fitted, kinks, score_from_video
from tt_sim.cameras.tracking_cameras import Sightings, TrackingCameraFaults
from tt_sim.world.outcome import Outcome, Result, free_flight_positions
from tt_sim.world.true_ball import Contact, Surface

AIR = Aerodynamics.measured().coefficients


def contact(surface, time, place, velocity, spin=(0, 0, 0)):
    ball = BallState(time, place, velocity, spin)
    return Contact(surface, ball, ball)


def test_a_fit_finds_the_flight_it_is_given():
    ball, times = np.array([-0.2, 0.7, 0.25, 3.5, 0.3, 2.5, 0.0, 120.0, 60.0]), np.arange(0.0, 0.6, 1 / 150)
    across = ball[6:] - (ball[6:] @ ball[3:6]) / (ball[3:6] @ ball[3:6]) * ball[3:6]
    ball[6:] = across
    found = fitted(times, free_flight_positions(ball, times, AIR), AIR)
    assert found[:6] == pytest.approx(ball[:6], abs=1e-3)  # m, m/s
    assert found[6:] == pytest.approx(ball[6:], abs=5.0)  # rad/s; what is expected of the spin draws it in a little


def test_kinks_are_where_the_velocity_changes():
    times = np.arange(0.0, 1.0, 1 / 150)
    seen = np.column_stack([np.abs(times - 0.3) * 4.0, np.zeros_like(times), np.abs(times - 0.6) * 3.0])
    rng = np.random.default_rng(0)
    for scatter in (0.0, 1e-3, 3e-3):  # m
        assert times[kinks(times, seen + scatter * rng.standard_normal(seen.shape))] == pytest.approx([0.3, 0.6], abs=0.011)


@pytest.mark.parametrize("world", ["liu", "real"])
def test_the_judge_agrees_with_the_truth(world):
    """Bounds in units of the scatter over 200 balls on the day: x, y 0.3 and 2.3 mm, time 0.15 and 0.25 ms, spin 1.1 and 29 rad/s."""
    sigma = {"liu": (0.4e-3, 0.15e-3, 2.0), "real": (2.4e-3, 0.3e-3, 30.0)}[world]
    returned = 0
    for seed in range(24):
        episode = play(load(world, images=False), seed)
        true, seen = episode.outcome, episode.judged
        assert seen.result == true.result and episode.judged_miss == episode.miss
        if true.result is Result.RETURNED:
            returned += 1
            assert seen.landing.before.position[:2] == pytest.approx(true.landing.before.position[:2], abs=5 * sigma[0])
            assert seen.landing.before.time == pytest.approx(true.landing.before.time, abs=5 * sigma[1])
            assert seen.hit.after.spin[1:] == pytest.approx(true.hit.after.spin[1:], abs=5 * sigma[2])
    assert returned >= 12


def test_perfect_cameras_and_a_known_air_see_the_truth():
    scenario = load("ideal", images=False)
    for seed in range(8):
        episode = play(scenario, seed)
        true, seen = episode.outcome, episode.judged
        assert seen.landing.before.position == pytest.approx(true.landing.before.position, abs=3e-4)  # m; 0.08 mm at most in 150
        assert seen.landing.before.time - seen.hit.before.time == pytest.approx(
            true.landing.before.time - true.hit.before.time, abs=5e-4
        )  # s; 0.2 ms at most
        assert seen.hit.after.spin[1:] == pytest.approx(true.hit.after.spin[1:], abs=0.5)  # rad/s; 0.05 at most


@pytest.mark.parametrize(
    ("velocity", "result", "surface"),
    [
        ([6.0, 0.0, 2.0], Result.OFF_TABLE, Surface.FLOOR),  # long
        ([2.5, 1.4, 2.5], Result.OFF_TABLE, Surface.FLOOR),  # wide
        ([1.0, 0.0, 1.0], Result.OWN_HALF, Surface.TABLE),
    ],
)
def test_what_is_not_a_return_is_told_apart(velocity, result, surface):
    """Flights made up here: a ball hit at x = -0.2 that flies until it meets the table's height."""
    air = Aerodynamics.gravity_only()
    coming = BallState(0.0, [2.0, 0.7, 0.3], [-4.0, 0.0, 2.4], [0, 0, 0])
    at = free_flight_positions(coming.vector, np.array([0.5]), air.coefficients)[0]
    back = BallState(0.5, at, velocity, [0, 0, 0])
    fall = 0.5 + (velocity[2] + np.sqrt(velocity[2] ** 2 + 2 * 9.8 * (at[2] - 0.02))) / 9.8
    end = free_flight_positions(back.vector, np.array([fall - 0.5]), air.coefficients)[0]
    speed = np.array([*velocity[:2], velocity[2] - 9.8 * (fall - 0.5)])
    down, up = BallState(fall, end, speed, [0, 0, 0]), BallState(fall, end, speed * [1, 1, -0.9], [0, 0, 0])
    contacts = [Contact(Surface.RACKET, BallState(0.5, at, [-4, 0, -2.5], [0, 0, 0]), back)]
    contacts.append(Contact(surface, down, up if surface is Surface.TABLE else down))
    seen = Sightings.of(Outcome(coming, contacts), air.coefficients, TrackingCameraFaults(), np.random.default_rng(0))
    assert score_from_video(seen, air.coefficients).result is result


def test_a_ball_that_nobody_met_is_missed_and_one_that_nobody_saw_too():
    scenario = Scenario("top", 4, robot=Robot(latency=1.5), images=False)
    episode = play(scenario, 0)
    assert episode.judged.result is episode.outcome.result is Result.MISSED and episode.judged_miss is episode.miss is Miss.TOO_LATE
    blind = play(replace(scenario, world=replace(scenario.world, tracking_cameras=TrackingCameraFaults(dropped=1.0))), 0)
    assert len(blind.sightings.times) == 0 and blind.judged.result is Result.MISSED
