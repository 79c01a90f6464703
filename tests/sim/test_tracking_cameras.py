"""The wide cameras see the table and tell noisy pixels of the ball."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tt_core.errors import OutOfRange
from tt_core.flight import Aerodynamics, fly
from tt_core.states import BallState
from tt_sim.cameras.tracking_cameras import Sightings, TrackingCameraFaults, TrackingCameraPair, believed
from tt_sim.render import Lamp, Lamps, Noise, Texture, render
from tt_sim.world.outcome import AFTER_LANDING, Outcome, free_flight_positions
from tt_sim.world.true_ball import Contact, Surface
from tt_vision.camera import triangulate

AIR = Aerodynamics.measured().coefficients
PERFECT = TrackingCameraFaults(noise=0.0, step=0.0)
HALL = Lamps((Lamp((1.37, 0.76, 3.0), 0.3), Lamp((0.0, -1.5, 3.0), 0.3), Lamp((2.74, -1.5, 3.0), 0.3)), ambient=0.3)


def test_both_see_the_ball_from_the_strike_to_behind_the_table():
    corners = np.array(list(itertools.product((-0.4, 2.9), (0.0, 1.525), (-0.1, 0.8))))
    seen = TrackingCameraPair(PERFECT, np.random.default_rng(0)).pixels(corners, np.random.default_rng(0))
    assert np.isfinite(seen).all()
    assert triangulate(believed(), seen) == pytest.approx(corners, abs=1e-9)


def test_places_are_those_of_the_flight():
    rng = np.random.default_rng(1)
    for _ in range(50):
        ball, times = np.concatenate([np.zeros(3), rng.normal(0, 5, 3), rng.normal(0, 200, 3)]), np.sort(rng.uniform(0, 0.7, 30))
        exact = [fly(ball, t, AIR)[:3] for t in times]
        assert free_flight_positions(ball, times, AIR) == pytest.approx(np.array(exact), abs=1e-5)  # m, as it promises


def test_a_flight_is_seen_on_both_sides_of_a_contact_until_it_is_over():
    launched = BallState(5.0, [2.5, 0.7, 0.3], [-4.0, 0.1, 2.6], [0, -100, 0])
    hit = BallState.from_vector(5.6, fly(launched.vector, 0.6, AIR))
    back = BallState(5.6, hit.position, [3.0, 0.0, 2.0], [0, 50, 0])
    landing = BallState.from_vector(6.1, fly(back.vector, 0.5, AIR))
    outcome = Outcome(launched, [Contact(Surface.RACKET, hit, back), Contact(Surface.TABLE, landing, landing)])
    seen = Sightings.of(outcome, AIR, PERFECT, np.random.default_rng(0))
    assert np.diff(seen.times) == pytest.approx(1 / 150, abs=1e-9)
    assert 5.0 <= seen.times[0] < 5.0 + 1 / 150 and 6.1 + AFTER_LANDING - 1 / 150 <= seen.times[-1] <= 6.1 + AFTER_LANDING
    at = triangulate(believed(), seen.pixels)
    before, after = np.searchsorted(seen.times, 5.3), np.searchsorted(seen.times, 5.8)
    assert at[before] == pytest.approx(
        fly(launched.vector, seen.times[before] - 5.0, AIR)[:3], abs=2e-5
    )  # m, as of `free_flight_positions`
    assert at[after] == pytest.approx(fly(back.vector, seen.times[after] - 5.6, AIR)[:3], abs=2e-5)


def test_faults_do_what_they_say():
    rng, at = np.random.default_rng(2), np.tile([1.5, 0.8, 0.2], (4000, 1))
    true = TrackingCameraPair(PERFECT, rng).pixels(at[:1], rng)
    seen = TrackingCameraPair(TrackingCameraFaults(noise=0.2, step=0.25, dropped=0.1), rng).pixels(at, rng)
    lost = np.isnan(seen[..., 0])
    assert lost.mean() == pytest.approx(0.1, abs=0.017)  # 5 standard deviations of 8,000 draws
    off = (seen - true)[~lost]
    assert off.std() == pytest.approx(np.hypot(0.2, 0.25 / 12**0.5), rel=0.04)  # 5 of 14,400
    wrong = TrackingCameraPair(replace(PERFECT, outliers=0.1, dead=1), rng).pixels(at, rng)
    assert np.isnan(wrong[1]).all()
    aside = np.linalg.norm(wrong[0] - true[0], axis=1)
    assert (aside > 1e-6).mean() == pytest.approx(0.1, abs=0.024)  # 5 standard deviations of 4,000 draws
    assert 0.2 / 0.006 > aside.max() > 20.0  # pixels; a pixel shows 6 mm at least
    pair = TrackingCameraPair(replace(PERFECT, latency=0.01, late=0.02), rng)
    delays = [pair.delay(rng) for _ in range(500)]
    assert 0.01 <= min(delays) < 0.011 and 0.029 < max(delays) <= 0.03
    assert np.round(seen[~lost] / 0.25) * 0.25 == pytest.approx(seen[~lost], abs=1e-12)
    turned = np.array(
        [TrackingCameraPair(TrackingCameraFaults(noise=0.0, step=0.0, turned=1e-3), rng).pixels(at[:1], rng) - true for _ in range(400)]
    )
    assert turned.std() == pytest.approx(1e-3 * 8.3e-3 / 7.4e-6, rel=0.2)  # pixels; 0.125 is 5 of 1,600, and the edge of the image adds
    with pytest.raises(OutOfRange) as error:
        TrackingCameraFaults(turned=1.0)
    assert (error.value.name, error.value.value, error.value.low, error.value.high) == ("turned", 1.0, 0.0, 0.1)


def test_the_noise_is_that_of_centroids_of_images():
    """A rendered ball in flight, 2 ms of exposure, cut at 0.3 of its brightness."""
    rng, off = np.random.default_rng(3), []
    for i in range(24):
        ball = BallState(
            0.0, rng.uniform([0.0, 0.3, 0.05], [2.7, 1.2, 0.5]), rng.normal([3.5, 0.0, 0.0], [1.0, 0.3, 1.5]), rng.normal(0, 100, 3)
        )
        for camera in believed():
            image = render(camera, ball, Rotation.random(rng=rng).as_matrix(), Texture.drawn(i % 20), HALL, 2e-3, Noise(), rng)
            centre = camera.project(ball.position[None])[0]
            left, top = np.round(centre).astype(int) - 12
            part = image[top : top + 25, left : left + 25].astype(float) - np.median(image)
            rows, columns = np.nonzero(part > 0.3 * np.percentile(part, 97))
            off.append([columns.mean() + left - centre[0], rows.mean() + top - centre[1]])
    # 0.09 pixels in 300 images; 96 numbers tell a standard deviation to 5 times 7 %
    assert np.std(off) == pytest.approx(TrackingCameraFaults().noise, rel=0.35)
    assert np.abs(np.mean(off, axis=0)).max() < TrackingCameraFaults().noise
