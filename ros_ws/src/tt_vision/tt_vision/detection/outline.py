"""Points on the outline of the ball in one image: rays from the ball's middle are scanned from outside inwards for the edge.

The edge is where the brightness rises to half of what the ball has just inside. How bright it is there is extrapolated from the pixels
further inside (`scan_outline`), or expected from marks and light that are known (`limb_refinement`); both share the kernels here.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.states import Array

RAYS = 64  # outline points looked for in one image
SAMPLE_STEP = 0.5  # pixels between two samples along a ray
BLUR = 0.7  # pixels, sigma of lens and motion at the outline; the outline moves by 0.02 pixels when this is off by 0.3
SMOOTH = 0.04  # relative deviation of the brightness along a ray from diffuse light that divides its weight by four: a mark
CONTRAST = 0.06  # least contrast of a ball, relative to full scale: 15 of 255 grey levels
DEPTH = 0.25  # threshold between background and brightest part of the ball, relative

INSIDE = (1.5, 6.0)  # pixels inside the edge between which the brightness is extrapolated
INSIDE_SAMPLES = 12  # samples of a ray that lie inside the innermost edge, for INSIDE
EDGE_COSINE = 0.4  # cosine to the line of sight at which the brightness of the edge is taken
LEAST_BRIGHTNESS = 0.15  # of the ball's contrast, that the edge must have just inside

OUTLINE_POINT = np.dtype([("camera", "i8"), ("frame", "i8"), ("u", "f8"), ("v", "f8"), ("weight", "f8")])
"""A point on an outline: in the image of which camera and frame, the pixel, and its weight from 0 to 1."""


class Inside(NamedTuple):
    """Brightness just inside an edge, linear in the cosine to the line of sight.

    Attributes:
        samples: Number of samples that it rests on; with fewer than 4 the others are 0.
        level: Grey levels over the background at the edge, where the cosine is 0.
        slope: Grey levels, rise to where the cosine is 1.
        ragged: Root mean square of the residuals, relative to the brightness at EDGE_COSINE.
    """

    samples: int
    level: float
    slope: float
    ragged: float


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def bilinear(image: np.ndarray, u: float, v: float) -> float:
    """Return the grey level at (u, v), which must be inside the image; not validated."""
    i, j = int(u), int(v)
    a, b = u - i, v - j
    return (1.0 - b) * ((1.0 - a) * image[j, i] + a * image[j, i + 1]) + b * ((1.0 - a) * image[j + 1, i] + a * image[j + 1, i + 1])


@njit(cache=True, nogil=True, forceinline=True)
def ray_direction(k: int) -> tuple[float, float]:
    """Return the unit direction, in the image, of ray k of RAYS."""
    return math.cos(2.0 * math.pi * k / RAYS), math.sin(2.0 * math.pi * k / RAYS)


@njit(cache=True, nogil=True, error_model="numpy")
def sample_ray(image: np.ndarray, u: float, v: float, k: int, outer: float, profile: Array) -> bool:
    """Sample ray k from (u, v): `profile[i]` becomes the grey level `outer - SAMPLE_STEP i` pixels from there.

    Returns:
        Whether the ray is in the image as far as `outer`; if not, `profile` is left as it is.
    """
    height, width = image.shape
    du, dv = ray_direction(k)
    if not (0.0 <= u + outer * du < width - 1 and 0.0 <= v + outer * dv < height - 1):
        return False
    for i in range(len(profile)):
        s = outer - SAMPLE_STEP * i
        profile[i] = bilinear(image, u + s * du, v + s * dv)
    return True


@njit(cache=True, nogil=True, forceinline=True)
def background_behind(profile: Array) -> float:
    """Return the background on this ray, from its outermost samples; it may be unlike that elsewhere."""
    return 0.25 * (profile[0] + profile[1] + profile[2] + profile[3])


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def crossing(profile: Array, i: int, threshold: float, outer: float) -> float:
    """Return where, in pixels from the middle, the profile rises to `threshold` between samples i - 1 and i."""
    return outer - SAMPLE_STEP * (i - (profile[i] - threshold) / (profile[i] - profile[i - 1]))


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def point_weight(brightness: float, contrast: float, ragged: float) -> float:
    """Return the weight of an outline point.

    Args:
        brightness: Grey levels of the ball at the edge, over the background.
        contrast: Grey levels of the ball's brightest part, over the background.
        ragged: Relative deviation from the brightness that is extrapolated or expected, in units of what divides the weight by four.
    """
    return min(1.0, brightness / (0.5 * contrast)) / (1.0 + ragged**2) ** 2


@njit(cache=True, nogil=True, error_model="numpy")
def scan_outline(image: np.ndarray, u: float, v: float, inner: float, outer: float, contrast: float, step: int = 1) -> np.ndarray:
    """Return the points of the ball's outline, (n,) OUTLINE_POINT with `camera` and `frame` 0.

    The edge is where the brightness falls to half of what the pixels inside it extrapolate to, so that a shaded side counts like a bright
    one.

    Args:
        image: (h, w) uint8 or uint16.
        u: Column of the ball's middle, pixels.
        v: Row of the ball's middle, pixels.
        inner: Pixels from the middle: where the scan for the edge ends.
        outer: Pixels from the middle: where the scan begins.
        contrast: Grey levels between the background and the brightest part of the ball.
        step: Every ray of this many is scanned.
    """
    count = int((outer - inner) / SAMPLE_STEP) + 1
    radius = 0.5 * (inner + outer)
    spread = 0.41 * math.sqrt(2.0 * BLUR / radius)  # mean of sqrt(2 x / radius) over a normal x > 0 of sigma BLUR
    profile = np.empty(count + INSIDE_SAMPLES)
    points = np.zeros(RAYS, dtype=OUTLINE_POINT)
    found = 0
    for k in range(0, RAYS, step):
        if not sample_ray(image, u, v, k, outer, profile):
            continue
        behind = background_behind(profile)
        for i in range(len(profile)):
            profile[i] -= behind
        first = 1
        while first < count and profile[first] < 0.5 * CONTRAST * contrast / DEPTH:
            first += 1
        if first >= count:
            continue
        edge, is_seen, inside = outer - SAMPLE_STEP * first, False, Inside(0, 0.0, 0.0, 0.0)
        for _ in range(2):
            inside = _brightness_inside(profile, edge, outer, radius)
            is_seen = inside.samples >= 4
            if not is_seen:
                break
            target = 0.5 * inside.level + spread * inside.slope
            i = max(1, first - 3)
            while i < len(profile) - 1 and profile[i] < target:
                i += 1
            is_steep = profile[i] - profile[i - 1] > 0.0 and i <= first + 5
            is_seen = is_steep and inside.level + EDGE_COSINE * inside.slope > LEAST_BRIGHTNESS * contrast
            if not is_seen:
                break
            edge = crossing(profile, i, target, outer)
        if not is_seen:
            continue
        du, dv = ray_direction(k)
        point = points[found]
        point.u, point.v = u + edge * du, v + edge * dv
        point.weight = point_weight(inside.level + EDGE_COSINE * inside.slope, contrast, inside.ragged / SMOOTH)
        found += 1
    return points[:found].copy()


@njit(cache=True, nogil=True, error_model="numpy")
def _brightness_inside(profile: Array, edge: float, outer: float, radius: float) -> Inside:
    """Fit the brightness just inside an edge. edge, outer, radius: pixels from the middle."""
    near, deep = INSIDE
    n, sx, sxx, sy, sxy, syy = 0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(max(0, int((outer - edge + near) / SAMPLE_STEP) + 1), min(int((outer - edge + deep) / SAMPLE_STEP), len(profile))):
        x = math.sqrt(2.0 * (SAMPLE_STEP * i - outer + edge) / radius)  # cosine to the line of sight: diffuse light is linear in it
        y = profile[i]
        n, sx, sxx, sy, sxy, syy = n + 1, sx + x, sxx + x * x, sy + y, sxy + x * y, syy + y * y
    if n < 4:
        return Inside(n, 0.0, 0.0, 0.0)
    slope = max(0.0, (n * sxy - sx * sy) / (n * sxx - sx * sx))
    level = (sy - slope * sx) / n
    if level < 0.0:
        level, slope = 0.0, sy / sx
    ragged = math.sqrt(max(0.0, syy - level * sy - slope * sxy) / n) / max(level + EDGE_COSINE * slope, 1e-9)
    return Inside(n, level, slope, ragged)
