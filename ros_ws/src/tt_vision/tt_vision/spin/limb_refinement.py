"""Find the outlines of the ball again, more accurately, once its marks (the printed or drawn dots) and the light on it are known.

A part of the surface that lies along the outline in one image is seen better in other images, because the ball turns. So the brightness
just inside the outline can be computed, marks included. The outline is where the image falls to half of this brightness, after blurring.
Distances along a ray are in pixels of a sharp image; in a blurred image they are larger by the factor `blur_scale`.
Without this, an outline with marks along it has an error of 0.1 pixels.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.constants import BALL_RADIUS
from tt_core.states import Array

from ..capture.burst import Burst
from ..detection.illumination import Illumination, camera_light, gloss_level, white_level
from ..detection.outline import (
    LEAST_BRIGHTNESS,
    OUTLINE_POINT,
    RAYS,
    SAMPLE_STEP,
    SMOOTH,
    background_behind,
    blur_scale,
    edge_crossing,
    point_weight,
    ray_direction,
    sample_ray,
)
from ..motion_fit import FINE_REACH
from ..projection import project_point, ray, unpack_camera, unpack_rotation
from .ball_marks import BallMarks, ball_marks, mark_at
from .registration import Registration
from .surface_map import SurfaceMap, view_optics

LEAST_MARK_WEIGHT = 0.05  # least weight of the known brightness of a place (see `mark_at`); a place with less is taken as white
DEPTHS = 14  # number of samples inside the outline, DEPTH_STEP apart, the first one half a step inside
DEPTH_STEP = 0.5  # pixels
SHALLOWEST, DEEPEST = 1.5, 6.0  # pixels inside the outline between which the image is compared with the expected brightness
MIDDLE_COSINE = 0.45  # cosine between normal and line of sight half way between SHALLOWEST and DEEPEST
BEND_PRIOR = 0.003  # weight of the prior that the light falls off towards the outline as expected; infinite with calibrated lamps
EDGE_DEPTHS = 6  # number of outermost samples inside the outline whose mean, weighted by the blur, is the brightness of the edge
LEAST_RATIO = 0.2  # least brightness of the image, relative to the expected one
MOST_EDGE_SHIFT = 3.0  # pixels, largest distance of the edge from where it is expected
RAGGED = 1.5 * SMOOTH  # relative deviation from the expected brightness that divides a point's weight by four
EDGE_PASSES = 3  # times that the edge along a ray is located; each time uses the brightness just inside the edge found before


class ExpectedEdge(NamedTuple):
    """Comparison of the image just inside the ball's edge, along one ray, with the brightness that is expected there.

    The ratio of the two is fitted as a linear function of the cosine between the ball's normal and the line of sight.

    Attributes:
        samples: Number of samples that were compared.
        ratio: Brightness of the image divided by the expected one, where the cosine is MIDDLE_COSINE.
        bend: Derivative of this ratio by the cosine.
        ragged: Root mean square residual of the fit, relative to the brightness of the image.
    """

    samples: int
    ratio: float
    bend: float
    ragged: float


def limb_outlines(burst: Burst, surface: SurfaceMap, found: Registration, blurs: Array) -> np.ndarray:
    """Find the points of the ball's outline in all images of a burst, with the brightness expected from its marks (dots) and the light.

    Args:
        burst: A burst (the images of one ball's passage) with cameras and detections.
        surface: The ball's surface in all images, with the light and the ball's position.
        found: The registration: spin and marks.
        blurs: (cameras,) pixels, sigma of lens and motion at the outline in each camera's images.

    Returns:
        (n,) OUTLINE_POINT; those of one image follow each other.
    """
    light, rows = surface.illumination, []
    expected = _limb_brightness(surface.images.views, ball_marks(surface, found), light, blurs)
    prior = math.inf if light.is_calibrated else BEND_PRIOR
    centres = np.ascontiguousarray(surface.images.views["centre"])
    for m in range(len(expected)):
        c, k = divmod(m, len(burst))
        contrast = burst.detections[c][k].contrast
        points = _scan_limb(burst.images[c][k], burst.cameras[c].vector, centres[m], contrast, expected[m], prior, blurs[c])
        points["camera"], points["frame"] = c, k
        rows.append(points)
    return np.concatenate(rows)


@njit(cache=True, nogil=True, error_model="numpy")
def _limb_brightness(views: np.ndarray, known: BallMarks, light: Illumination, blurs: Array) -> Array:
    """Compute the grey levels, over the background, that are expected just inside the outline: (images, RAYS, DEPTHS).

    A part of the surface that no image shows well enough is taken as white.

    Args:
        views: (images,) VIEW, how a camera sees the ball in each image.
        known: The brightness of the ball's surface.
        light: The light on the ball.
        blurs: (cameras,) pixels, see `limb_outlines`.
    """
    images, cameras = len(views), len(light.harmonics)
    marks, texels = known.marks, known.texels
    out = np.empty((images, RAYS, DEPTHS))
    for m in range(images):
        c = m * cameras // images
        optics, of_camera, gain, step = view_optics(views[m]), camera_light(light, c), light.gains[m], blur_scale(blurs[c]) * DEPTH_STEP
        turn, centre = unpack_rotation(known.turns[m]), views[m].centre
        cx, cy, cz = centre[0], centre[1], centre[2]
        square = cx * cx + cy * cy + cz * cz - BALL_RADIUS**2
        u, v = project_point(optics, cx, cy, cz)
        radius = optics.focal * BALL_RADIUS / cz
        for k in range(RAYS):
            du, dv = ray_direction(k)
            for d in range(DEPTHS):
                s = radius - step * (d + 0.5)
                x, y = ray(optics, u + s * du, v + s * dv)
                z = 1.0 / math.sqrt(x * x + y * y + 1.0)
                x, y = x * z, y * z
                along = x * cx + y * cy + z * cz
                reach = along - math.sqrt(max(0.0, along * along - square))
                nx, ny, nz = (reach * x - cx) / BALL_RADIUS, (reach * y - cy) / BALL_RADIUS, (reach * z - cz) / BALL_RADIUS
                mark = mark_at(marks, texels, turn, nx, ny, nz, LEAST_MARK_WEIGHT)
                white = white_level(nx, ny, -nz, cx, cy, cz, of_camera)
                out[m, k, d] = max(0.0, gain * ((1.0 if mark < 0.0 else mark) * white + gloss_level(nx, ny, -nz, of_camera)))
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _scan_limb(image: np.ndarray, camera: Array, centre: Array, contrast: float, expected: Array, prior: float, blur: float) -> np.ndarray:
    """Find the points of the ball's outline in one image, (n,) OUTLINE_POINT with `camera` and `frame` 0.

    Args:
        image: (h, w) uint8 or uint16.
        camera: (20,) `Camera.vector`.
        centre: (3,) m, centre of the ball in the camera's frame.
        contrast: Difference in grey levels between the brightest part of the ball and the background.
        expected: (RAYS, DEPTHS) expected grey levels just inside the outline, over the background.
        prior: Weight of the prior that the ratio of the image to the expected brightness does not change towards the outline.
        blur: Sigma of lens and motion at the outline, pixels.
    """
    scale = blur_scale(blur)
    optics = unpack_camera(camera).optics
    u, v = project_point(optics, centre[0], centre[1], centre[2])
    radius = optics.focal * BALL_RADIUS / centre[2]
    outer, step = radius + scale * FINE_REACH, scale * SAMPLE_STEP
    profile = np.empty(int((2.0 * FINE_REACH + DEEPEST) / SAMPLE_STEP) + 1)
    points, found, weights = np.zeros(RAYS, dtype=OUTLINE_POINT), 0, _blur_weights(blur / scale)
    for k in range(RAYS):
        if not sample_ray(image, u, v, k, outer, step, profile):
            continue
        behind = background_behind(profile)
        edge, is_seen, compared, bright = radius, False, ExpectedEdge(0, 0.0, 0.0, 0.0), 0.0
        for _ in range(EDGE_PASSES):
            compared = _compare_inside(profile, behind, edge, radius, expected[k], prior, scale)
            is_seen = compared.samples >= 4 and compared.ratio > LEAST_RATIO
            if not is_seen:
                break
            bright = _edge_brightness(compared, expected[k], radius / scale, weights)
            threshold, closest = behind + 0.5 * bright, np.inf
            for i in range(1, len(profile)):
                if profile[i - 1] < threshold <= profile[i]:
                    s = edge_crossing(profile, i, threshold, outer, step)
                    if abs(s - radius) < closest:
                        closest, edge = abs(s - radius), s
            is_seen = closest < scale * MOST_EDGE_SHIFT and bright > LEAST_BRIGHTNESS * contrast
            if not is_seen:
                break
        if is_seen:
            du, dv = ray_direction(k)
            point = points[found]
            point.u, point.v = u + edge * du, v + edge * dv
            point.weight = point_weight(bright, contrast, compared.ragged / RAGGED)
            found += 1
    return points[:found].copy()


@njit(cache=True, nogil=True, error_model="numpy")
def _compare_inside(profile: Array, behind: float, edge: float, radius: float, expected: Array, prior: float, scale: float) -> ExpectedEdge:
    """Compare the image with the expected brightness along one ray just inside an edge, by a linear least-squares fit.

    Args:
        profile: (n,) grey levels along the ray, from outside inwards.
        behind: Grey level of the background on this ray.
        edge: Distance of the edge from the ball's centre, pixels.
        radius: Radius of the ball in the image, pixels.
        expected: (DEPTHS,) expected grey levels over the background.
        prior: Weight of the prior that the ratio of the two does not change towards the outline.
        scale: Factor on all distances along the ray.
    """
    edge, radius = edge / scale, radius / scale  # in pixels of a sharp image from here on
    outer = radius + FINE_REACH
    n, xx, xy, yy, zz, xz, zy = 0, 1e-9, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(
        max(0, math.ceil((outer - edge + SHALLOWEST) / SAMPLE_STEP)), min(len(profile), int((outer - edge + DEEPEST) / SAMPLE_STEP) + 1)
    ):
        depth = SAMPLE_STEP * i - outer + edge
        at = max(0.0, depth / DEPTH_STEP - 0.5)
        d = min(DEPTHS - 2, int(at))
        x = expected[d] + (at - d) * (expected[d + 1] - expected[d])
        y, z = profile[i] - behind, x * (math.sqrt(2.0 * depth / radius) - MIDDLE_COSINE)
        n, xx, xy, yy, zz, xz, zy = n + 1, xx + x * x, xy + x * y, yy + y * y, zz + z * z, xz + x * z, zy + z * y
    zz += prior * xx
    bend = (zy - xz * xy / xx) / (zz - xz * xz / xx)
    ratio = (xy - bend * xz) / xx
    return ExpectedEdge(n, ratio, bend, math.sqrt(max(0.0, yy - ratio * xy - bend * zy) / max(yy, 1e-9)))


@njit(cache=True, nogil=True)
def _blur_weights(blur: float) -> Array:
    """Return the weights (EDGE_DEPTHS,) of the outermost samples in the brightness of the edge, blurred by `blur`; their sum is 1."""
    weights = np.empty(EDGE_DEPTHS)
    for d in range(EDGE_DEPTHS):
        weights[d] = math.exp(-0.5 * (DEPTH_STEP * (d + 0.5) / blur) ** 2)
    return weights / weights.sum()


@njit(cache=True, nogil=True, error_model="numpy")
def _edge_brightness(compared: ExpectedEdge, expected: Array, radius: float, weights: Array) -> float:
    """Compute the brightness of the ball at its edge, in grey levels over the background: the blurred mean of the outermost samples.

    Args:
        compared: Ratio of the image to the expected brightness.
        expected: (DEPTHS,) expected grey levels just inside the outline, over the background.
        radius: Radius of the ball in the image, pixels.
        weights: (EDGE_DEPTHS,) weights of the samples, from `_blur_weights`.
    """
    bright = 0.0
    for d in range(EDGE_DEPTHS):
        cosine = math.sqrt(2.0 * DEPTH_STEP * (d + 0.5) / radius)
        bright += weights[d] * expected[d] * max(0.0, compared.ratio + compared.bend * (cosine - MIDDLE_COSINE))
    return bright
