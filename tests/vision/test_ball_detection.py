"""The ball is found where it is, and only where it is."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter
from tt_core.errors import BadShape, TtError
from tt_vision.detection.ball_detection import FAR_REACH, NEAR_REACH, DetectionReason, NoWholeBall, ball_centre, find_ball, fit_outline
from tt_vision.detection.outline import BLUR, MOST_SHARP_BLUR, edge_blur
from tt_vision.spin.dissertation import centre_by_four_points, four_points


def disc(u, v, radius=35.0, *, size=232, inside=200.0, outside=8.0, dtype=np.uint8):
    """An evenly lit disc, its edge one pixel wide."""
    y, x = np.mgrid[:size, :size]
    cover = np.clip(radius - np.hypot(x - u, y - v) + 0.5, 0.0, 1.0)
    return np.round(outside + (inside - outside) * cover).astype(dtype)


inside_view = st.floats(42.0, 188.0)


@settings(max_examples=30)
@given(inside_view, inside_view, st.floats(20.0, 37.0))
def test_the_centre_of_a_disc_is_found(u, v, radius):
    image = disc(u, v, radius)
    ball = find_ball(image)
    assert ball.reason is None
    assert np.hypot(ball.u - u, ball.v - v) < 2.0
    assert ball.radius == pytest.approx(radius, rel=0.2)
    # 0.04 pixels: edges of a drawn disc are not those of a lens; the worst of 200 draws was 0.021
    assert np.hypot(*(ball_centre(image) - [u, v])) < 0.04
    # the four-point method sees whole pixels along each side
    assert np.hypot(*(centre_by_four_points(image, ball) - [u, v])) < 1.5


@pytest.mark.parametrize("radius", [20.0, 37.0, 75.0])
@pytest.mark.parametrize("blur", [0.0, 0.6, 1.0, 2.0, 2.5, 3.0])
def test_the_blur_of_the_outline_is_told(blur, radius):
    """OWN_BLUR includes the motion of a real ball. This disc does not move, so that the result is 0.3 too small for blurred ones."""
    image = gaussian_filter(disc(116.0, 116.0, radius).astype(float), blur)
    image = np.round(image + 2.0 * np.random.default_rng(0).standard_normal(image.shape)).clip(0.0, 255.0).astype(np.uint8)
    told = edge_blur(image, fit_outline(image, np.array([117.0, 115.0, radius]), 192.0, True))
    if blur < MOST_SHARP_BLUR:
        assert told == BLUR
    else:
        assert told == pytest.approx(blur, abs=0.4)


def test_an_outline_that_is_not_there_has_the_blur_of_a_sharp_image():
    image = np.full((64, 64), 20, dtype=np.uint8)
    none = fit_outline(image, np.array([32.0, 32.0, 15.0]), 192.0, True)
    assert len(none) == 0 and edge_blur(image, none) == BLUR


@given(inside_view, inside_view)
@settings(max_examples=10)
def test_a_shifted_image_has_a_shifted_centre(u, v):
    image = disc(u, v)
    moved = np.roll(image, (3, -2), axis=(0, 1))
    assert ball_centre(moved) - ball_centre(image) == pytest.approx([-2.0, 3.0], abs=5e-3)  # the fit starts from every second pixel


def test_depth_of_grey_does_not_matter():
    image = disc(100.3, 120.7)
    for factor, top in ((4, 1023), (16, 4095), (257, 65535)):
        deep = np.minimum(image.astype(np.uint16) * factor, top)
        assert ball_centre(deep) == pytest.approx(ball_centre(image), abs=1e-3)  # the threshold is a whole grey level


def test_a_marked_and_shaded_ball_is_found(rendered):
    """Against the projection of the true centre, which the outline's middle misses by 0.02 pixels (perspective)."""
    for images, camera in zip(rendered.frames, rendered.cameras, strict=True):
        true = camera.project(rendered.ball.position[None])[0]
        # 0.2 pixels is 0.11 mm; the light of two lamps leaves 0.05 to 0.15
        assert np.hypot(*(ball_centre(images[-1]) - true)) < 0.2
        # the four points sit on marks and shadow: 0.8 mm is the usual, 3 mm the worst
        assert np.hypot(*(centre_by_four_points(images[-1], find_ball(images[-1])) - true)) < 5.0


@pytest.mark.parametrize(
    ("image", "reason"),
    [
        (np.zeros((232, 232), np.uint8), DetectionReason.BLACK),
        (np.full((232, 232), 255, np.uint8), DetectionReason.SATURATED),
        (np.full((232, 232), 120, np.uint8), DetectionReason.NO_CONTRAST),
        (disc(116, 116, inside=255.0), DetectionReason.SATURATED),
        (disc(116, 116, 5.0), DetectionReason.TOO_SMALL),
        (disc(700, 700, 330.0, size=1400), DetectionReason.TOO_LARGE),
        (disc(20, 116), DetectionReason.NOT_WHOLE),
        (disc(116, 225), DetectionReason.NOT_WHOLE),
        (np.random.default_rng(0).integers(0, 255, (232, 232)).astype(np.uint8), DetectionReason.NOT_WHOLE),
    ],
)
def test_what_is_no_ball_has_a_reason(image, reason):
    found = find_ball(image).reason
    assert found.code is reason
    with pytest.raises(NoWholeBall) as error:
        ball_centre(image)
    assert error.value.failure == found


def test_a_lamp_elsewhere_in_view_does_not_matter():
    image = disc(120.4, 110.2)
    image[20:40, 30:45] = 220
    assert ball_centre(image) == pytest.approx([120.4, 110.2], abs=0.04)


@pytest.mark.parametrize("seed", range(12))
def test_a_fitted_circle_stays_in_the_ring_that_was_scanned(seed):
    """A straight edge through the middle; the circle fitted to it had a radius of up to 5,000 pixels, and as much was cut out."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[:120, :120] - 60.0
    angle, start = rng.uniform(0.0, 6.3), np.array([60.0, 60.0, rng.uniform(12.0, 25.0)])
    image = np.where(u * np.cos(angle) + v * np.sin(angle) > rng.uniform(-15.0, 15.0), 50, 20).astype(np.uint8)
    fit_outline(image, circle := start.copy(), 30.0, True)
    assert np.abs(circle - start).max() <= FAR_REACH * start[2] + NEAR_REACH


def test_bad_images_say_what_they_are():
    with pytest.raises(TtError):
        find_ball(np.zeros((232, 232)))
    with pytest.raises(BadShape) as error:
        find_ball(np.zeros((232, 232, 3), np.uint8))
    assert error.value.shape == (232, 232, 3)
    with pytest.raises(TtError):
        four_points(np.zeros((9, 9), np.uint8), 10.0)
