"""The image is that of a lit, marked, moving sphere."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tt_core.constants import BALL_RADIUS
from tt_core.errors import NotFinite, OutOfRange
from tt_core.states import BallState
from tt_sim.render import Lamp, Lamps, Noise, Texture, _axes, _Box, _corners, _pixel, render
from tt_vision.rig import EXPOSURE, VIEW_CENTRE, high_speed_pair

CAMERAS = high_speed_pair()
EVEN = Lamps((), ambient=0.8, background=0.0)
CLEAN = Noise(lens_blur=0.0, full_scale=1e9, read=0.0, bits=16)
PLAIN = Texture.plain(1.0)
AT = np.array(VIEW_CENTRE)


def ball(position=AT, velocity=(0, 0, 0), spin=(0, 0, 0)):
    return BallState(0.0, np.array(position), np.array(velocity, dtype=float), np.array(spin, dtype=float))


def picture(state, *, camera=CAMERAS[0], texture=PLAIN, lamps=EVEN, exposure=0.0, noise=CLEAN, turn=None, seed=0):
    turn = np.eye(3) if turn is None else turn
    return render(camera, state, turn, texture, lamps, exposure, noise, np.random.default_rng(seed)).astype(float)


def middle(image):
    v, u = np.mgrid[: image.shape[0], : image.shape[1]]
    return np.array([(image * u).sum(), (image * v).sum()]) / image.sum()


@pytest.mark.parametrize("offset", [(0, 0, 0), (0.03, 0.01, -0.02), (-0.035, 0.0, 0.03)])
def test_an_evenly_lit_ball_is_where_it_projects_to(offset):
    for camera in CAMERAS:
        state = ball(AT + offset)
        image = picture(state, camera=camera) / 65535
        distance = np.linalg.norm(state.position - camera.position)
        radius = camera.focal_pixels * math.tan(math.asin(BALL_RADIUS / distance))
        # 0.5 %: sixteen rays in each pixel of the rim, and an outline that perspective makes an ellipse
        assert image.sum() / 0.8 == pytest.approx(math.pi * radius**2, rel=5e-3)
        # 0.1 pixels: the middle of the outline is off the projected centre by 0.05 at the edge of the view
        assert middle(image) == pytest.approx(camera.project(state.position[None])[0], abs=0.1)


def test_nothing_is_seen_of_a_ball_elsewhere():
    for place in (AT + [0.3, 0.0, 0.0], 2.0 * CAMERAS[0].position - AT):
        assert picture(ball(place)).max() == 0.0


def test_a_part_of_a_ball_at_the_edge_is_seen():
    image = picture(ball(AT + [0.07, 0.0, 0.0]))
    assert 0.0 < (image > 0).mean() < 0.06
    assert image[:, -1].max() > 0.0


def test_motion_blurs_along_the_way_and_keeps_the_middle():
    still, moving = picture(ball()), picture(ball(velocity=(-7.0, 0.0, 0.0)), exposure=EXPOSURE)
    grey = [((image > 0.05 * image.max()) & (image < 0.95 * image.max())).sum() for image in (still, moving)]
    assert grey[1] > 1.5 * grey[0]
    assert middle(moving) == pytest.approx(middle(still), abs=0.05)
    assert moving.sum() == pytest.approx(still.sum(), rel=2e-3)


def test_spin_blurs_marks_and_leaves_the_outline():
    texture = Texture.drawn(0)
    still, spun = (picture(ball(spin=(0.0, w, 0.0)), texture=texture, exposure=EXPOSURE) for w in (0.0, 900.0))
    assert (still > 0).sum() == pytest.approx((spun > 0).sum(), rel=0.01)
    assert (np.diff(spun) ** 2).sum() < 0.9 * (np.diff(still) ** 2).sum()


def test_turning_ball_and_lamps_and_camera_together_changes_nothing():
    camera, turn = CAMERAS[0], Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    texture, lamps = Texture.drawn(1), Lamps(background=0.0)
    turned = Lamps(tuple(dataclasses.replace(lamp, position=tuple(turn @ lamp.position)) for lamp in lamps.lamps), lamps.ambient, 0.0)
    one = picture(ball(), texture=texture, lamps=lamps)
    seen = dataclasses.replace(camera, rotation=camera.rotation @ turn.T)
    other = picture(ball(turn @ AT), camera=seen, texture=texture, lamps=turned, turn=turn)
    # rays at the edge of a mark may round to the next texel
    assert np.abs(one - other).mean() < 0.002 * one.max()


def test_the_side_towards_the_lamp_is_bright():
    camera = CAMERAS[0]
    for side in (-1.0, 1.0):
        lamp = Lamp(tuple(AT + side * camera.rotation[0]), 0.8, flicker=0.0)
        image = picture(ball(), lamps=Lamps((lamp,), 0.02, 0.0))
        assert side * (middle(image)[0] - 115.5) > 3.0


def test_light_falls_with_the_square_of_the_distance():
    camera = CAMERAS[0]
    away = camera.position - AT
    greys = []
    for distance in (0.5, 1.0):
        lamp = Lamp(tuple(AT + away / np.linalg.norm(away) * (distance + BALL_RADIUS)), 0.2, flicker=0.0)
        greys.append(picture(ball(), texture=Texture(PLAIN.albedo, 0.0), lamps=Lamps((lamp,), 0.0, 0.0))[114:118, 114:118].mean())
    assert greys[0] / greys[1] == pytest.approx(4.0, rel=0.01)


@pytest.mark.parametrize("distortion", [None, (-0.2, 0.05, 1e-3, -1e-3)])
def test_rays_are_linear_within_a_pixel(distortion):
    camera = dataclasses.replace(CAMERAS[0], distortion=distortion)
    axes = _axes(camera.vector, ball().vector)
    corners = _corners(camera.vector, axes, _Box(0, camera.width, 0, camera.height))
    rng = np.random.default_rng(0)
    for u, v in rng.integers(0, 232, (200, 2)):
        a, b = rng.uniform(size=2)
        x, y = ([1.0, a, b] @ np.array(_pixel(corners, v, u, k)) for k in (0, 1))
        seen = camera.project((camera.position + np.array([x, y, 1.0]) @ axes)[None])[0]
        assert seen == pytest.approx([u - 0.5 + a, v - 0.5 + b], abs=1e-4)  # pixels; 2e-5 at most on the day


def test_sixteen_rays_are_enough():
    """Against the mean of many renderings: no more than the 1.6 grey levels (of 255) that the sensor adds, even at 6 m/s and 5,000 rpm."""
    state, texture = ball(velocity=(-6.0, 0.0, 1.0), spin=(100.0, -500.0, 200.0)), Texture.drawn(2)
    many = [picture(state, texture=texture, lamps=Lamps(), exposure=EXPOSURE, seed=seed) / 257 for seed in range(20)]
    assert np.mean([np.sqrt(((image - np.mean(many, axis=0))[80:152, 80:152] ** 2).mean()) for image in many]) < 2.0


def test_noise_is_that_of_the_sensor():
    noise = Noise(lens_blur=0.0, full_scale=20e3, read=65.0, bits=16)
    images = np.array([picture(ball(), noise=noise, seed=seed) for seed in range(40)]) / 65535 * 20e3
    light = images[:, 110:120, 110:120]
    assert light.std(axis=0).mean() == pytest.approx(math.sqrt(0.8 * 20e3 + 65.0**2), rel=0.05)


def test_marks_cover_what_is_asked():
    for coverage in (0.05, 0.13, 0.25):
        ink = (0.85 - Texture.drawn(3, coverage=coverage).albedo) / (0.85 - 0.08)
        n = ink.shape[1]
        a = (2.0 * np.arange(n) + 1.0) / n - 1.0
        solid = (1.0 + a[:, None] ** 2 + a**2) ** -1.5
        assert np.average(ink, weights=np.broadcast_to(solid, ink.shape)) == pytest.approx(coverage, abs=0.01)


def test_the_same_seed_is_the_same_image():
    one, other = (picture(ball(), lamps=Lamps(), noise=Noise(), seed=4) for _ in range(2))
    assert (one == other).all()
    assert (Texture.drawn(5).albedo == Texture.drawn(5).albedo).all()
    assert (Texture.drawn(5).albedo != Texture.drawn(6).albedo).any()


def test_bits_and_bad_values():
    assert render(CAMERAS[0], ball(), np.eye(3), PLAIN, EVEN, 0.0, Noise(bits=10), np.random.default_rng(0)).dtype == np.uint16
    with pytest.raises(OutOfRange) as bits:
        Noise(bits=17)
    with pytest.raises(NotFinite) as orientation:
        picture(ball(), turn=np.full((3, 3), np.nan))
    assert (bits.value.name, bits.value.value, orientation.value.name) == ("bits", 17, "orientation")
