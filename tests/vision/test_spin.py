"""The spin is found, at any speed and about any axis, or refused."""

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from tt_core.constants import RPM
from tt_core.errors import BadChoice, BadShape
from tt_core.so3 import left_jacobian, rotation_matrix
from tt_eval.synthetic_bursts import BurstConditions, bursts, render_burst
from tt_sim.render import Lamp, Lamps, Noise, Texture
from tt_vision.capture.burst import TimesNotRising
from tt_vision.first_estimate import estimator_of
from tt_vision.measure import measure
from tt_vision.rig import VIEW_CENTRE
from tt_vision.spin import SearchParams, SpinReason, estimate_spin
from tt_vision.spin.comparison import compare_all
from tt_vision.spin.estimate import SpinEstimate
from tt_vision.spin.registration import GATE, MOST_DISPARITY, with_near_rivals
from tt_vision.spin.surface_map import cut_surface
from tt_vision.spin.wide_search import aliases

vectors = st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3).map(np.array)


def miss(shot, **options):
    estimate = estimate_spin(shot.frames, shot.times, shot.cameras, **options)
    assert estimate.reason is None, estimate.reason
    return np.linalg.norm(estimate.spin - shot.ball.spin) / RPM


@given(vectors)
def test_the_rotation_is_the_exponential(v):
    assert rotation_matrix(v) == pytest.approx(Rotation.from_rotvec(v).as_matrix(), abs=1e-12)


@given(vectors, vectors)
def test_the_left_jacobian_is_that_of_finite_differences(v, d):
    h = 1e-6
    turned = Rotation.from_rotvec(v + h * d) * Rotation.from_rotvec(v).inv()
    assert turned.as_rotvec() / h == pytest.approx(left_jacobian(v) @ d, abs=1e-4)


AXES = [(1, 0, 0), (0, -1, 0), (0, 0, 1), (-0.6, 0.0, 0.8), (0.5, -0.7, -0.5)]


@pytest.mark.parametrize(("speed", "axis"), [*itertools.product((500.0, 3000.0, 9000.0), AXES), (0.0, (0, 0, 1))])
def test_the_spin_is_found(film, speed, axis):
    shot = film(round(speed) + len(str(axis)), spin=speed * np.array(axis) / np.linalg.norm(axis))
    # rpm, what is promised at 95 %; of 300 bursts the worst was 22
    assert miss(shot) < 30.0


def test_cameras_that_tell_different_spins_are_not_believed(film, scene):
    """Three marks, so few that near rivals are searched. A wrong pose of the right camera, by 10 deg, turns the spin that it measures."""
    shot = film(3, spin=(0.0, 0.0, 6000.0), scene=scene(texture=Texture.drawn(2, blobs=3, coverage=0.08)))
    first = estimator_of(shot.burst).estimate(shot.burst)
    surface, frames = cut_surface(shot.burst, first.motion, first.light).lit_by(first.light), len(shot.times)
    whole = with_near_rivals(surface, first.found)
    assert 0.0 < whole.disparity < 0.5 * MOST_DISPARITY and whole.is_consistent
    surface.images.views["rotation"][frames:] = surface.images.views["rotation"][frames:] @ rotation_matrix(np.array([0.17, 0.0, 0.0]))
    apart = with_near_rivals(surface, first.found)
    assert not apart.is_consistent and not apart.is_believed
    only = dataclasses.replace(whole, disparity=apart.disparity, alternatives=np.empty((0, 3)), distinctness=np.inf)
    assert SpinEstimate.not_believed(only).reason.code is SpinReason.INCONSISTENT


def test_the_covariance_covers_the_error(rendered):
    estimate = estimate_spin(rendered.frames, rendered.times, rendered.cameras)
    error = estimate.spin - rendered.ball.spin
    assert error @ np.linalg.solve(estimate.covariance, error) < 16.3  # chi-square of 3, 99.9 %
    assert np.linalg.eigvalsh(estimate.covariance).min() > 0.0


def test_the_same_images_in_a_turned_world_turn_the_spin(rendered):
    turn = Rotation.from_rotvec([0.0, 0.0, 1.0]).as_matrix()
    turned = [dataclasses.replace(c, rotation=c.rotation @ turn.T) for c in rendered.cameras]
    one = estimate_spin(rendered.frames, rendered.times, rendered.cameras).spin
    other = estimate_spin(rendered.frames, rendered.times, turned).spin
    # 8 rpm: the points of the fit lie otherwise on the ball; 4 on the day
    assert np.linalg.norm(other - turn @ one) / RPM < 8.0


def test_time_run_backwards_turns_backwards(rendered):
    one = estimate_spin(rendered.frames, rendered.times, rendered.cameras).spin
    other = estimate_spin(rendered.frames[:, ::-1], rendered.times, rendered.cameras).spin
    assert np.linalg.norm(one + other) / RPM < 6.0  # gravity now pulls upwards: 0.03 m/s, shared over two cameras; 4.1 at most in 20 balls


def test_a_frame_lost_in_the_middle_does_not_matter(rendered):
    kept = [0, 1, 2, 4, 5]
    estimate = estimate_spin(rendered.frames[:, kept], rendered.times[kept], rendered.cameras)
    assert np.linalg.norm(estimate.spin - rendered.ball.spin) / RPM < 30.0


@pytest.mark.parametrize(
    "parts",
    [
        {"lamps": Lamps((Lamp((2.1, 0.2, 0.8), 0.35),), 0.2)},
        {"lamps": Lamps((), 0.7)},
        {"noise": Noise(gamma=2.2)},
        {"noise": Noise(bits=10)},
        {"noise": Noise(lens_blur=1.2)},
        {"noise": Noise(read=300.0)},
        {"texture": Texture.drawn(9, blobs=20)},
    ],
    ids=["one lamp", "no lamp", "gamma", "10 bit", "out of focus", "noisy", "20 marks"],
)
def test_other_light_lenses_and_balls_do_not_matter(film, scene, parts):
    assert miss(film(21, scene=scene(**parts))) < 30.0


def test_one_camera_alone_is_enough(film):
    shot = film(22, fastest=5000.0)
    estimate = estimate_spin(shot.frames[:1], shot.times, shot.cameras[:1])
    assert estimate.reason is None
    assert np.linalg.norm(estimate.spin - shot.ball.spin) / RPM < 100.0


def test_a_bare_ball_is_refused(film, scene):
    shot = film(23, scene=scene(texture=Texture.plain()))
    estimate = estimate_spin(shot.frames, shot.times, shot.cameras)
    assert estimate.reason.code is SpinReason.NO_MARKS
    assert estimate.covariance[0, 0] >= 1e6


def test_marks_of_another_ball_are_refused(film):
    one, other = film(24, velocity=[-5.0, 0, 0]), film(25, velocity=[-5.0, 0, 0])
    mixed = one.frames.copy()
    mixed[:, 1::2] = other.frames[:, 1::2]
    estimate = estimate_spin(mixed, one.times, one.cameras)
    assert estimate.reason is not None


SLOW_CAMERA = BurstConditions(frames=12, frame_rate=380.0)


def turning(seed, speed, frame_rate=380.0):
    """A ball at 2 m/s that turns at `speed` rad/s about a random axis, before a slow camera."""
    rng = np.random.default_rng(seed)
    axis = rng.standard_normal(3)
    spin = speed * axis / np.linalg.norm(axis)
    conditions = dataclasses.replace(SLOW_CAMERA, frame_rate=frame_rate)
    return render_burst(np.array(VIEW_CENTRE), np.array([-2.0, 0.0, 0.3]), spin, Texture.drawn(seed), conditions, rng)


@pytest.mark.parametrize(("seed", "speed"), [(1, 630.0), (2, 780.0), (4, 940.0)])
def test_a_slow_camera_alone_measures_a_ball_that_turns_by_up_to_142_deg_a_frame(seed, speed):
    burst = turning(seed, speed)
    estimate = estimate_spin(burst.images[:1], burst.times, burst.cameras[:1], search=SearchParams(max_spin=1000.0))
    assert estimate.reason is None
    assert np.linalg.norm(estimate.spin - burst.ball.spin) < 0.01 * speed  # 0.005 at most on 11 such balls


def test_without_a_larger_search_such_a_spin_is_refused():
    burst = turning(2, 780.0)
    assert estimate_spin(burst.images[:1], burst.times, burst.cameras[:1]).reason.code is SpinReason.NO_AGREEMENT


def test_spins_that_the_frame_rate_does_not_tell_apart_are_all_named():
    burst = turning(3, 300.0)
    estimate = estimate_spin(burst.images, burst.times, burst.cameras, search=SearchParams(max_spin=2500.0))
    assert estimate.reason.code is SpinReason.AMBIGUOUS
    expected = [burst.ball.spin, *aliases(burst.ball.spin, 1.0 / 380.0, 2500.0)]
    assert len(estimate.alternatives) == len(expected) == 2
    for spin, found in zip(expected, estimate.alternatives, strict=True):
        assert np.linalg.norm(found - spin) < 0.02 * np.linalg.norm(spin)


@given(vectors, st.floats(0.001, 0.02), st.floats(1.0, 3000.0))
def test_an_alias_turns_the_ball_alike(v, gap, largest):
    spin = 300.0 * v
    for other in aliases(spin, gap, largest):
        assert np.linalg.norm(other) <= largest * (1.0 + 1e-9)
        assert rotation_matrix(gap * other) == pytest.approx(rotation_matrix(gap * spin), abs=1e-9)


def test_spins_up_to_12000_rpm_are_found():
    errors = [
        np.linalg.norm(estimate_spin(b.images, b.times, b.cameras).spin - b.ball.spin) / RPM
        for b in bursts(6, BurstConditions(slowest=10000.0, fastest=12000.0), seed=4)
    ]
    assert max(errors) < 60.0  # rpm; 33 on the day


def test_marks_tell_the_distance_of_a_single_camera():
    burst = turning(5, 900.0)
    result = measure(burst.images[0], None, burst.times, burst.cameras[:1], search=SearchParams(max_spin=1000.0))
    camera, ball = burst.cameras[0], result.ball
    depths = [(camera.rotation @ x + camera.translation)[2] for x in (ball.position, burst.ball.position)]
    flown = (camera.rotation @ burst.ball.velocity)[2] * (burst.ball.time - ball.time)  # the last frame need not be used
    assert abs(depths[0] + flown - depths[1]) < 0.005  # m; the outline alone is off by up to 0.018


def test_too_fast_to_tell_is_refused(film):
    shot = film(26, spin=[0.0, 14000.0, 12000.0])
    reason = estimate_spin(shot.frames, shot.times, shot.cameras).reason
    assert reason.code is SpinReason.NO_AGREEMENT and reason.values["residual"] > GATE


def test_the_step_of_the_refinement_leads_to_the_spin(rendered):
    """From 20 rpm away in any direction one Gauss-Newton step comes most of the way; the other points on the ball move it by 4."""
    first = estimator_of(rendered.burst).estimate(rendered.burst)
    surface = cut_surface(rendered.burst, first.motion, first.light).lit_by(first.light)
    best = estimate_spin(rendered.frames, rendered.times, rendered.cameras, search=SearchParams(second_look=False)).spin
    points = Rotation.random(2000, random_state=0).as_matrix()[:, 0].astype(np.float32)
    for start in best + 20.0 * RPM * np.vstack([np.eye(3), -np.eye(3)]):
        found = compare_all(start, points, surface.images)
        assert np.linalg.norm(start - np.linalg.solve(found.normal_matrix, found.gradient) - best) / RPM < 8.0


def test_method_2_finds_slow_spin_near_its_start(film):
    shot = film(27, spin=[700.0, -800.0, 600.0])
    # the dissertation: 89 % within 200 rpm in speed
    assert miss(shot, method="liu") < 300.0


def test_method_1_sees_a_turn_across_the_line_of_sight(film):
    shot = film(28, spin=[2000.0, 0.0, 0.0])
    estimate = estimate_spin(shot.frames, shot.times, shot.cameras, method="correlation")
    # marks near the rim lag behind, and one pixel of shift in a frame is 250 rpm: half to all of the truth is what it gives
    assert 700.0 < estimate.spin[0] / RPM < 2500.0


def test_arguments_that_do_not_fit_say_so(rendered):
    with pytest.raises(BadChoice) as error:
        estimate_spin(rendered.frames, rendered.times, rendered.cameras, method="magic")
    assert error.value.value == "magic"
    with pytest.raises(BadShape) as error:
        estimate_spin(rendered.frames, rendered.times[:5], rendered.cameras)
    assert error.value.shape == (2, 6, 6)
    with pytest.raises(TimesNotRising):
        estimate_spin(rendered.frames, rendered.times[::-1], rendered.cameras)
