"""The outlines of the ball found again, once its marks and its light are known.

What lies along the outline in one image is seen better in others, before or after it has turned there. So the brightness just inside can be
expected, mark by mark, and the outline is where the image falls to half of it, blurred. Without this, an outline with marks along it is 0.1
pixels off.
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
    BLUR,
    OUTLINE_POINT,
    RAYS,
    SAMPLE_STEP,
    SMOOTH,
    background_behind,
    crossing,
    point_weight,
    ray_direction,
    sample_ray,
)
from ..motion_fit import FINE_REACH
from ..projection import project_point, ray, unpack_camera, unpack_rotation
from .ball_marks import BallMarks, ball_marks, mark_at
from .registration import Registration
from .surface_map import SurfaceMap, view_optics

LEAST_MARK_WEIGHT = 0.05  # of 1 for a pixel seen straight on, on which a mark must rest; a place without one is taken as white
DEPTHS = 14  # samples inside the outline, DEPTH_STEP apart, the first one half a step inside
DEPTH_STEP = 0.5  # pixels
NEAREST, DEEPEST = 1.5, 6.0  # pixels inside the outline between which image and expectation are compared
MIDDLE_COSINE = 0.45  # cosine to the line of sight half way between NEAREST and DEEPEST
BEND_PRIOR = 0.003  # weight of the prior that the light falls off towards the outline as expected; with calibrated lamps that is certain
EDGE_DEPTHS = 6  # first samples inside the outline, whose mean, weighted by the blur, is the brightness of the edge
LEAST_RATIO = 0.2  # of the expected brightness, that the image must have
LEAST_BRIGHTNESS = 0.15  # of the ball's contrast, that the edge must have just inside
MOST_SHIFT = 3.0  # pixels between the edge and where it is expected
RAGGED = 1.5 * SMOOTH  # relative deviation from the expected brightness that divides a point's weight by four
PASSES = 3  # over the edge of one ray


class ExpectedEdge(NamedTuple):
    """The image just inside an edge beside what is expected there.

    Attributes:
        samples: Number of samples compared.
        ratio: Image over expectation, at MIDDLE_COSINE.
        bend: By how much the ratio rises with the cosine to the line of sight.
        ragged: Root mean square of the residuals, relative to the image.
    """

    samples: int
    ratio: float
    bend: float
    ragged: float


def limb_outlines(burst: Burst, surface: SurfaceMap, found: Registration) -> np.ndarray:
    """Return the outline points in all images, (n,) OUTLINE_POINT, by the marks and the light that are expected.

    Args:
        burst: A burst with cameras and detections.
        surface: Its marks and light.
        found: Its spin.
    """
    light, rows = surface.illumination, []
    expected = _limb_brightness(surface.images.views, ball_marks(surface, found), light)
    prior = math.inf if light.is_calibrated else BEND_PRIOR
    centres = np.ascontiguousarray(surface.images.views["centre"])
    for m in range(len(expected)):
        c, k = divmod(m, len(burst))
        contrast = burst.detections[c][k].contrast
        points = _scan_limb(burst.images[c][k], burst.cameras[c].vector, centres[m], contrast, expected[m], prior)
        points["camera"], points["frame"] = c, k
        rows.append(points)
    return np.concatenate(rows)


@njit(cache=True, nogil=True, error_model="numpy")
def _limb_brightness(views: np.ndarray, known: BallMarks, light: Illumination) -> Array:
    """Return the grey levels expected just inside the outline, (images, RAYS, DEPTHS); white where no image shows what is there."""
    images, cameras = len(views), len(light.harmonics)
    marks, texels = known.marks, known.texels
    out = np.empty((images, RAYS, DEPTHS))
    for m in range(images):
        optics, of_camera, gain = view_optics(views[m]), camera_light(light, m * cameras // images), light.gains[m]
        turn, centre = unpack_rotation(known.turns[m]), views[m].centre
        cx, cy, cz = centre[0], centre[1], centre[2]
        square = cx * cx + cy * cy + cz * cz - BALL_RADIUS**2
        u, v = project_point(optics, cx, cy, cz)
        radius = optics.focal * BALL_RADIUS / cz
        for k in range(RAYS):
            du, dv = ray_direction(k)
            for d in range(DEPTHS):
                s = radius - DEPTH_STEP * (d + 0.5)
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
def _scan_limb(image: np.ndarray, camera: Array, centre: Array, contrast: float, expected: Array, prior: float) -> np.ndarray:
    """Return the points of the ball's outline, (n,) OUTLINE_POINT with `camera` and `frame` 0.

    Args:
        image: (h, w) uint8 or uint16.
        camera: `Camera.vector`.
        centre: (3,) m, of the ball in the camera's frame.
        contrast: Grey levels between the background and the brightest part of the ball.
        expected: (RAYS, DEPTHS) grey levels just inside the outline.
        prior: Weight of the prior that the ratio of image and expectation does not change towards the outline.
    """
    optics = unpack_camera(camera).optics
    u, v = project_point(optics, centre[0], centre[1], centre[2])
    radius = optics.focal * BALL_RADIUS / centre[2]
    outer = radius + FINE_REACH
    profile = np.empty(int((2.0 * FINE_REACH + DEEPEST) / SAMPLE_STEP) + 1)
    points, found, weights = np.zeros(RAYS, dtype=OUTLINE_POINT), 0, _blur_weights()
    for k in range(RAYS):
        if not sample_ray(image, u, v, k, outer, profile):
            continue
        behind = background_behind(profile)
        edge, is_seen, compared, bright = radius, False, ExpectedEdge(0, 0.0, 0.0, 0.0), 0.0
        for _ in range(PASSES):
            compared = _compare_inside(profile, behind, edge, radius, expected[k], prior)
            is_seen = compared.samples >= 4 and compared.ratio > LEAST_RATIO
            if not is_seen:
                break
            bright = _edge_brightness(compared, expected[k], radius, weights)
            threshold, closest = behind + 0.5 * bright, np.inf
            for i in range(1, len(profile)):
                if profile[i - 1] < threshold <= profile[i]:
                    s = crossing(profile, i, threshold, outer)
                    if abs(s - radius) < closest:
                        closest, edge = abs(s - radius), s
            is_seen = closest < MOST_SHIFT and bright > LEAST_BRIGHTNESS * contrast
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
def _compare_inside(profile: Array, behind: float, edge: float, radius: float, expected: Array, prior: float) -> ExpectedEdge:
    """Fit the expectation (DEPTHS,), times a ratio that is linear in the cosine to the line of sight, to a ray's profile inside an edge."""
    outer = radius + FINE_REACH
    n, xx, xy, yy, zz, xz, zy = 0, 1e-9, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(
        max(0, math.ceil((outer - edge + NEAREST) / SAMPLE_STEP)), min(len(profile), int((outer - edge + DEEPEST) / SAMPLE_STEP) + 1)
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
def _blur_weights() -> Array:
    """Return the weights (EDGE_DEPTHS,) with which the blur mixes the first depths at the edge; their sum is 1."""
    weights = np.empty(EDGE_DEPTHS)
    for d in range(EDGE_DEPTHS):
        weights[d] = math.exp(-0.5 * (DEPTH_STEP * (d + 0.5) / BLUR) ** 2)
    return weights / weights.sum()


@njit(cache=True, nogil=True, error_model="numpy")
def _edge_brightness(compared: ExpectedEdge, expected: Array, radius: float, weights: Array) -> float:
    """Return the grey level of the edge over the background: the mean over the first depths of `expected` (DEPTHS,)."""
    bright = 0.0
    for d in range(EDGE_DEPTHS):
        cosine = math.sqrt(2.0 * DEPTH_STEP * (d + 0.5) / radius)
        bright += weights[d] * expected[d] * max(0.0, compared.ratio + compared.bend * (cosine - MIDDLE_COSINE))
    return bright
