"""The tracker follows a ball through whatever is seen of it, knows how well, and survives what it cannot use."""

import contextlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tt_core.errors import TtError
from tt_core.events import MOST_BOUNCES, StopKind, walk_entry
from tt_core.physics import Physics
from tt_core.states import BallPath, BallState
from tt_vision.rig import wide_pair
from tt_vision.tracking import Tracker, TrackerParams

PHYSICS, CAMERAS = Physics.measured(), wide_pair()
MIRROR = np.array([1, -1, 1, 1, -1, 1, -1, 1, -1])
RATE, PIXELS, METRES = 150.0, 0.15, 0.002  # 1/s, pixels, m
SIGMAS = np.repeat([5e-4, 0.02, 5.0], 3)  # m, m/s, rad/s: of a measured ball
BROAD = np.eye(3) * METRES**2


def flown(state, physics=PHYSICS, duration=0.62):
    rows = np.empty((400, 10))
    n, _, _ = walk_entry(
        0.0, np.array(state, float), int(StopKind.TIME), 0.0, duration, physics.coefficients, rows, np.empty(MOST_BOUNCES, np.int64)
    )
    return BallPath(rows[:n, 0], rows[:n, 1:4], rows[:n, 4:7], rows[:n, 7:10])


def shot(rng):
    """A ball that lands on the robot's half, with a spin across its flight."""
    spin = rng.normal(size=3) * [20, 150, 150]
    return np.array([2.62, 0.76, 0.34, rng.uniform(-6.5, -5), rng.normal() * 0.2, rng.uniform(0.8, 1.6), *spin])


def times(path, rng):
    return np.arange(rng.uniform() / RATE, path.times[-1], 1.0 / RATE)


def pixels(tracker, path, time, rng, cameras=(0, 1), sigma=PIXELS):
    for index in cameras:
        seen = CAMERAS[index].project(path.at(time).position[None])[0]
        tracker.add_pixel(time, index, seen + rng.normal(0.0, sigma, 2), sigma)


def error(ball, path):
    return ball.vector - path.at(ball.time).vector


def nees(ball, path):
    e = error(ball, path)
    return e @ np.linalg.solve(ball.covariance, e) / 9.0


def test_positions_alone_give_place_velocity_and_spin():
    rng = np.random.default_rng(0)
    path, tracker = flown([2.62, 0.76, 0.34, -6.0, 0.1, 1.2, 10, -300, 20]), Tracker(PHYSICS)
    assert tracker.state() is None
    for t in times(path, rng):
        tracker.add_position(t, path.at(t).position + rng.normal(0, METRES, 3), BROAD)
    ball = tracker.state()
    off, sigma = np.abs(error(ball, path)), np.sqrt(np.diag(ball.covariance))
    assert (off < 5.0 * sigma).all()
    assert off[:3].max() < 2 * METRES and off[3:6].max() < 0.05 and off[6:].max() < 60.0  # after a bounce; 3 sigma
    ahead = tracker.state(ball.time + 0.05)
    assert np.trace(ahead.covariance[:3, :3]) > np.trace(ball.covariance[:3, :3])


@pytest.mark.parametrize("kind", ["pixels", "positions", "measured"])
def test_errors_are_as_large_as_told(kind):
    rng, found = np.random.default_rng(1), []
    for _ in range(25):
        path = flown(shot(rng))
        tracker = Tracker(PHYSICS, CAMERAS)
        if kind == "measured":
            tracker.start(BallState.from_vector(0.0, path.at(0.0).vector + rng.normal(size=9) * SIGMAS, np.diag(SIGMAS**2)))
        for i, t in enumerate(times(path, rng)):
            if kind == "positions":
                tracker.add_position(t, path.at(t).position + rng.normal(0, METRES, 3), BROAD)
            else:
                pixels(tracker, path, t, rng)
            if i % 8 == 7:
                found.append(nees(tracker.state(), path))
    # 275 states of 25 flights: the mean of a flight scatters by about 0.3, so the mean of all by 0.06; 1.4 is what is promised.
    # Above the promise's lower bound of 0.7 the median lies at 0.6, because errors of the few first states have long tails
    assert 0.5 < np.median(found) < 1.2
    if kind == "measured":
        assert 0.7 < np.mean(found) < 1.4


def test_the_order_of_measurements_does_not_matter():
    rng = np.random.default_rng(2)
    path = flown(shot(rng))
    seen = [(t, path.at(t).position + rng.normal(0, METRES, 3)) for t in times(path, rng)[:45]]
    balls = []
    for order in (range(45), rng.permutation(45), range(44, -1, -1)):
        tracker = Tracker(PHYSICS)
        for i in order:
            tracker.add_position(*seen[i], BROAD)
        balls.append(tracker.state())
    for other in balls[1:]:
        assert other.vector == pytest.approx(balls[0].vector, abs=1e-9)


def test_late_measurements_count_at_their_stamp():
    rng = np.random.default_rng(3)
    path = flown(shot(rng))
    stamps = times(path, rng)
    arrivals = np.argsort(stamps + rng.uniform(0.0, 0.02, len(stamps)))
    balls = []
    for order in (range(len(stamps)), arrivals):
        tracker, noise = Tracker(PHYSICS), np.random.default_rng(4).normal(0, METRES, (len(stamps), 3))
        for i in order:
            tracker.add_position(stamps[i], path.at(stamps[i]).position + noise[i], BROAD)
            tracker.state()
        balls.append(tracker.state())
        assert tracker.counts.late <= 1
    sigma = np.sqrt(np.diag(balls[0].covariance))
    assert np.abs(balls[0].vector - balls[1].vector) / sigma == pytest.approx(0.0, abs=0.3)  # sigmas: windows start at other measurements


def test_a_mirror_image_is_tracked_mirrored():
    rng = np.random.default_rng(5)
    path = flown(shot(rng))
    one, other = Tracker(PHYSICS), Tracker(PHYSICS)
    for t in times(path, rng):
        place = path.at(t).position + rng.normal(0, METRES, 3)
        one.add_position(t, place, BROAD)
        other.add_position(t, [place[0], 1.525 - place[1], place[2]], BROAD)
    wanted = one.state().vector * MIRROR + [0, 1.525, *7 * [0]]
    sigma = np.sqrt(np.diag(one.state().covariance))
    assert np.abs(other.state().vector - wanted) / sigma == pytest.approx(0.0, abs=0.05)  # sigmas, of rounding and the last Newton step


@pytest.mark.parametrize("fault", ["lost", "outliers", "one camera"])
def test_faults_of_cameras_do_not_lead_it_astray(fault):
    rng = np.random.default_rng(6)
    for _ in range(5):
        path = flown(shot(rng))
        tracker = Tracker(PHYSICS, CAMERAS)
        tracker.start(BallState.from_vector(0.0, path.at(0.0).vector + rng.normal(size=9) * SIGMAS, np.diag(SIGMAS**2)))
        for t in times(path, rng):
            if fault == "lost" and rng.uniform() < 0.3:
                continue
            if fault == "outliers" and rng.uniform() < 0.05:
                wrong = path.at(t).position + 0.2 * np.array([0.0, 0.6, 0.8])
                tracker.add_pixel(t, 0, CAMERAS[0].project(wrong[None])[0], PIXELS)
                continue
            pixels(tracker, path, t, rng, cameras=(0,) if fault == "one camera" else (0, 1))
        off, sigma = np.abs(error(tracker.state(), path)), np.sqrt(np.diag(tracker.state().covariance))
        assert (off < 5.0 * sigma).all()
        assert off[:3].max() < 0.02


def test_outliers_do_not_keep_it_from_starting():
    rng, started = np.random.default_rng(7), 0
    for _ in range(20):
        path, tracker = flown(shot(rng)), Tracker(PHYSICS, CAMERAS)
        for t in times(path, rng)[:12]:
            pixels(tracker, path, t, rng)
            if rng.uniform() < 0.1:
                tracker.add_pixel(t, 1, rng.uniform(0, 400, 2), PIXELS)
        ball = tracker.state()
        started += ball is not None and np.linalg.norm(error(ball, path)[:3]) < 0.02
    assert started >= 19  # 20 on the day


def test_a_wrong_track_is_left_for_the_ball_that_is_seen():
    rng = np.random.default_rng(8)
    path, tracker = flown(shot(rng)), Tracker(PHYSICS, CAMERAS)
    tracker.start(BallState(0.0, [2.0, 0.2, 0.6], [-4, 1, 0], [0, 200, 0], np.diag(SIGMAS**2)))
    for t in times(path, rng)[:40]:
        pixels(tracker, path, t, rng)
        ball = tracker.state()
    assert np.abs(error(ball, path))[:3].max() < 0.01
    assert tracker.counts.restarts == 1


def test_a_hit_starts_another_track():
    rng = np.random.default_rng(9)
    path, tracker = flown(shot(rng), duration=0.3), Tracker(PHYSICS)
    for t in times(path, rng):
        tracker.add_position(t, path.at(t).position + rng.normal(0, METRES, 3), BROAD)
    hit = path.end.vector * [1, 1, 1, -1, 1, 1, 1, 1, 1] + [0, 0, 0, 0, 0, 2, 0, 0, 0]
    back = flown(hit, duration=0.2)
    for t in times(back, rng):
        tracker.add_position(0.3 + t, back.at(t).position + rng.normal(0, METRES, 3), BROAD)
        ball = tracker.state()
    assert ball.velocity == pytest.approx(back.at(ball.time - 0.3).velocity, abs=0.3)


@pytest.mark.parametrize("jump", [-1e6, -3.0, 3.0, 1e6])
def test_a_clock_that_jumps_costs_no_more_than_a_track(jump):
    rng = np.random.default_rng(10)
    path, tracker = flown(shot(rng)), Tracker(PHYSICS)
    for offset in (0.0, jump):
        for t in times(path, rng):
            tracker.add_position(offset + t, path.at(t).position + rng.normal(0, METRES, 3), BROAD)
    assert tracker.state().position == pytest.approx(path.at(tracker.state().time - jump).position, abs=0.01)


def test_a_single_stamp_from_the_future_costs_nothing():
    rng = np.random.default_rng(11)
    path, tracker = flown(shot(rng)), Tracker(PHYSICS)
    for i, t in enumerate(times(path, rng)):
        tracker.add_position(t, path.at(t).position + rng.normal(0, METRES, 3), BROAD)
        if i == 20:
            tracker.add_position(t + 1e5, [0.0, 0.0, 0.0], BROAD)
    assert np.abs(error(tracker.state(), path))[:3].max() < 0.01


def test_told_deviations_that_are_far_too_small_are_not_believed():
    rng = np.random.default_rng(12)
    path, tracker = flown(shot(rng)), Tracker(PHYSICS)
    for t in times(path, rng):
        tracker.add_position(t, path.at(t).position + rng.normal(0, 0.004, 3), np.eye(3) * 0.0005**2)
    off, sigma = np.abs(error(tracker.state(), path)), np.sqrt(np.diag(tracker.state().covariance))
    assert (off < 5.0 * sigma).all()


def test_factors_of_the_ball_are_found():
    rng = np.random.default_rng(13)
    physics = Physics.measured()
    truth = Physics(type(physics.air)(1.15 * physics.air.drag, 0, 0, 0, physics.air.lift_ratio, 0.353, 0.08), physics.table, physics.racket)
    path, tracker = flown([2.62, 0.76, 0.34, -6.0, 0.1, 1.3, 10, -200, 20], truth), Tracker(physics)
    for t in times(path, rng):
        tracker.add_position(t, path.at(t).position + rng.normal(0, 5e-4, 3), np.eye(3) * 5e-4**2)
    values, covariance = tracker.factors
    assert values[0] == pytest.approx(np.log(1.15), abs=4.0 * np.sqrt(covariance[0, 0]))
    assert tracker.physics.air.drag == pytest.approx(physics.air.drag * np.exp(values[0]))


nonsense = st.one_of(st.floats(allow_nan=True, allow_infinity=True), st.sampled_from([1e300, -1e300, 0.0, 1e-300]))


@given(st.lists(st.tuples(nonsense, st.tuples(nonsense, nonsense, nonsense), nonsense, st.integers(-3, 3)), max_size=12))
@settings(max_examples=60)
def test_nonsense_is_refused_or_survived(rows):
    tracker = Tracker(PHYSICS, CAMERAS)
    for time, place, spread, camera in rows:
        with contextlib.suppress(TtError):
            tracker.add_position(time, place, np.diag([spread] * 3))
        with contextlib.suppress(TtError):
            tracker.add_pixel(time, camera, place[:2], spread)
        with contextlib.suppress(TtError):
            tracker.start(BallState(time, place, place, place, np.diag([spread] * 9)))
        with contextlib.suppress(TtError):
            tracker.state(time)
    ball = tracker.state()
    assert ball is None or np.isfinite(ball.covariance).all()


@pytest.mark.parametrize(
    "call",
    [
        lambda t: t.add_position(np.nan, np.zeros(3), BROAD),
        lambda t: t.add_position(0.0, [0.0, np.inf, 0.0], BROAD),
        lambda t: t.add_position(0.0, [0.0, 0.0], BROAD),
        lambda t: t.add_position(0.0, np.zeros(3), np.eye(2)),
        lambda t: t.add_position(0.0, np.zeros(3), np.diag([1.0, -1.0, 1.0])),
        lambda t: t.add_position(0.0, np.zeros(3), np.zeros((3, 3))),
        lambda t: t.add_position(0.0, np.zeros(3), [[1, 5, 0], [0, 1, 0], [0, 0, 1]]),
        lambda t: t.add_position(0.0, "abc", BROAD),
        lambda t: t.add_pixel(0.0, 2, [1.0, 1.0], 0.1),
        lambda t: t.add_pixel(0.0, -1, [1.0, 1.0], 0.1),
        lambda t: t.add_pixel(0.0, 0.5, [1.0, 1.0], 0.1),
        lambda t: t.add_pixel(0.0, 0, [1.0], 0.1),
        lambda t: t.add_pixel(0.0, 0, [1.0, 1.0], 0.0),
        lambda t: t.add_pixel(0.0, 0, [1.0, np.nan], 0.1),
        lambda t: t.start(BallState(0.0, np.zeros(3), np.zeros(3), np.zeros(3), -np.eye(9))),
        lambda t: t.start(BallState(0.0, [1e5, 0, 0], np.zeros(3), np.zeros(3), np.eye(9))),
        lambda t: t.state(np.nan),
        lambda t: TrackerParams(lag=-1.0),
    ],
)
def test_bad_input_is_refused(call):
    with pytest.raises(TtError):
        call(Tracker(PHYSICS, CAMERAS))


def test_the_history_is_bounded():
    rng = np.random.default_rng(14)
    path, tracker = flown(shot(rng)), Tracker(PHYSICS)
    for t in np.linspace(0.0, 0.3, 3000):
        tracker.add_position(t, path.at(t).position + rng.normal(0, METRES, 3), BROAD)
    assert np.abs(error(tracker.state(), path))[:3].max() < 0.005
    for t in np.linspace(0.3, 0.4, 2000):  # nothing that is a ball
        tracker.add_position(t, rng.uniform(-2, 2, 3), BROAD)
    tracker.state()


def test_a_known_spin_stays_known_when_pixels_are_noisier_than_told():
    rng, sigmas = np.random.default_rng(12), np.repeat([1e-4, 5e-3, 0.3], 3)
    for _ in range(30):
        path, tracker = flown(shot(rng)), Tracker(PHYSICS, CAMERAS, TrackerParams(camera_bias=0.2))
        tracker.start(BallState.from_vector(0.0, path.at(0.0).vector + rng.normal(size=9) * sigmas, np.diag(sigmas**2)))
        for t in times(path, rng)[:2]:
            for index in (0, 1):
                pixel = CAMERAS[index].project(path.at(t).position[None])[0] + rng.normal(0.0, 4 * PIXELS, 2)
                tracker.add_pixel(t, index, pixel, PIXELS)
        assert np.abs(error(tracker.state(), path)[6:]).max() < 3.0  # rad/s, ten standard deviations
