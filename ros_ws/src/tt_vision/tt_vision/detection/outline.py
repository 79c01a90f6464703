"""Points on the outline of the ball in one image: rays from the ball's centre are scanned from outside inwards for the edge of the ball.

The edge is where the brightness rises to half of the brightness of the ball just inside the edge. That brightness is extrapolated from the
pixels further inside (`scan_outline`), or computed from the light and from the ball's marks, the printed or drawn dots on it, once these
are known (`spin.limb_refinement`). Both methods share the compiled functions of this module.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.states import Array

RAYS = 64  # outline points looked for in one image
SAMPLE_STEP = 0.5  # pixels between two samples along a ray in a sharp image
BLUR = 0.7  # pixels, sigma of lens and motion at the outline of a sharp image; the outline moves by 0.02 pixels when this is off by 0.3
MOST_SHARP_BLUR = 1.2  # pixels, sigma up to which an image counts as sharp, so that BLUR is used
SCANNED_BLUR = 0.95  # pixels; in a blurred image the distances along a ray are multiplied by the blur divided by this
MOST_BLUR = 3.5  # pixels, largest sigma that `edge_blur` returns
BLUR_REACH, BLUR_DEPTH = 10.0, 6.0  # pixels outside and inside the outline between which the blur is estimated
STEEP = 2  # the edge is steepest where the samples this many places before and after differ most
LEAST_TAIL = 0.05  # samples darker than this share of the brightness at the steepest place are taken as background
OWN_BLUR = 0.85  # pixels, sigma that pixels, interpolation and errors of the outline add to the blur that is estimated
SMOOTH = 0.04  # relative deviation of the brightness along a ray from diffuse light, as by a mark, that divides a point's weight by four
CONTRAST = 0.06  # least contrast of a ball, relative to full scale: 15 of 255 grey levels
BALL_THRESHOLD = 0.25  # threshold between the background (0) and the brightest part of the ball (1)

INSIDE = (1.5, 6.0)  # pixels inside the edge between which the brightness is extrapolated, in a sharp image
INSIDE_SAMPLES = 12  # samples of a ray inside the innermost possible edge, as many as INSIDE needs
EDGE_COSINE = 0.4  # cosine between the ball's normal and the line of sight at which the brightness near the edge is taken
LEAST_BRIGHTNESS = 0.15  # least brightness just inside the edge, relative to the ball's contrast

OUTLINE_POINT = np.dtype([("camera", "i8"), ("frame", "i8"), ("u", "f8"), ("v", "f8"), ("weight", "f8")])
"""A point on an outline: in the image of which camera and frame, the pixel, and its weight from 0 to 1."""


class Inside(NamedTuple):
    """Brightness of the ball just inside its edge along one ray: a linear fit over the cosine between the normal and the line of sight.

    Attributes:
        samples: Number of samples of the fit; if it is less than 4, the other attributes are 0.
        level: Brightness at the edge, where the cosine is 0, in grey levels over the background.
        slope: Increase in grey levels from there to where the cosine is 1.
        ragged: Root mean square residual of the fit, relative to the brightness at EDGE_COSINE.
    """

    samples: int
    level: float
    slope: float
    ragged: float


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def bilinear(image: np.ndarray, u: float, v: float) -> float:
    """Return the grey level at column u and row v by bilinear interpolation; the point must be inside the image, which is not checked."""
    i, j = int(u), int(v)
    a, b = u - i, v - j
    return (1.0 - b) * ((1.0 - a) * image[j, i] + a * image[j, i + 1]) + b * ((1.0 - a) * image[j + 1, i] + a * image[j + 1, i + 1])


@njit(cache=True, nogil=True, forceinline=True)
def ray_direction(k: int) -> tuple[float, float]:
    """Return the unit direction (u, v) in the image of ray number k of RAYS."""
    return math.cos(2.0 * math.pi * k / RAYS), math.sin(2.0 * math.pi * k / RAYS)


@njit(cache=True, nogil=True, forceinline=True)
def blur_scale(blur: float) -> float:
    """Return the factor by which distances along a ray are multiplied in an image with this blur (sigma, pixels); 1 for a sharp image."""
    return max(1.0, blur / SCANNED_BLUR)


@njit(cache=True, nogil=True, error_model="numpy")
def sample_ray(image: np.ndarray, u: float, v: float, k: int, outer: float, step: float, profile: Array) -> bool:
    """Sample the grey levels along one ray from the ball's centre, from outside inwards.

    Args:
        image: (h, w) uint8 or uint16.
        u: Column of the ball's centre, pixels.
        v: Row of the ball's centre, pixels.
        k: Number of the ray, 0 to RAYS - 1.
        outer: Distance of the first sample from the centre, pixels.
        step: Distance between two samples, pixels.
        profile: (n,) is filled: `profile[i]` is the grey level at `outer - step * i` pixels from the centre.

    Returns:
        Whether the ray is inside the image as far as `outer`; if not, `profile` stays as it is.
    """
    height, width = image.shape
    du, dv = ray_direction(k)
    if not (0.0 <= u + outer * du < width - 1 and 0.0 <= v + outer * dv < height - 1):
        return False
    for i in range(len(profile)):
        s = outer - step * i
        profile[i] = bilinear(image, u + s * du, v + s * dv)
    return True


@njit(cache=True, nogil=True, forceinline=True)
def background_behind(profile: Array) -> float:
    """Return the grey level of the background next to the ball on one ray: the mean of its four outermost samples."""
    return 0.25 * (profile[0] + profile[1] + profile[2] + profile[3])


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def edge_crossing(profile: Array, i: int, threshold: float, outer: float, step: float) -> float:
    """Find where the brightness along a ray rises to a threshold between two neighbouring samples, by linear interpolation.

    Args:
        profile: (n,) grey levels along the ray, see `sample_ray`.
        i: Index of the inner one of the two samples; the other one is i - 1.
        threshold: Grey level.
        outer: Distance of the first sample from the ball's centre, pixels.
        step: Distance between two samples, pixels.

    Returns:
        Distance from the ball's centre, pixels.
    """
    return outer - step * (i - (profile[i] - threshold) / (profile[i] - profile[i - 1]))


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def point_weight(brightness: float, contrast: float, ragged: float) -> float:
    """Return the weight of an outline point, 0 to 1.

    Args:
        brightness: Brightness of the ball near this point, in grey levels over the background.
        contrast: Brightness of the ball's brightest part, in grey levels over the background.
        ragged: Relative deviation of the brightness along the ray from the expected one, divided by that deviation which divides the weight
            by four (such as SMOOTH).
    """
    return min(1.0, brightness / (0.5 * contrast)) / (1.0 + ragged**2) ** 2


@njit(cache=True, nogil=True, error_model="numpy")
def edge_blur(image: np.ndarray, points: np.ndarray) -> float:
    """Estimate the blur of an image from the ball's outline, sigma in pixels.

    The brightness is averaged over all rays, aligned at their outline points. From the place where it rises most, outwards, it falls like a
    blurred step, whatever the light on the ball is; its integral there is proportional to the blur.

    Args:
        image: (h, w) uint8 or uint16.
        points: (n,) OUTLINE_POINT, the outline in this image.

    Returns:
        The blur, at most MOST_BLUR; BLUR for a sharp image, and if there are no usable outline points.
    """
    profile = np.empty(int((BLUR_REACH + BLUR_DEPTH) / SAMPLE_STEP) + 1)
    total, height, width = np.zeros(len(profile)), image.shape[0], image.shape[1]
    middle_u, middle_v = points["u"].mean(), points["v"].mean()
    for point in points:
        du, dv = point.u - middle_u, point.v - middle_v
        length = math.sqrt(du * du + dv * dv)
        du, dv = du / length, dv / length
        first_u, first_v = point.u + BLUR_REACH * du, point.v + BLUR_REACH * dv
        if not (0.0 <= first_u < width - 1 and 0.0 <= first_v < height - 1):
            continue
        for i in range(len(total)):
            s = SAMPLE_STEP * i
            total[i] += point.weight * bilinear(image, first_u - s * du, first_v - s * dv)
    total -= background_behind(total)
    steepest, rise = STEEP, 0.0
    for i in range(STEEP, len(total) - STEEP):
        if total[i + STEEP] - total[i - STEEP] > rise:
            steepest, rise = i, total[i + STEEP] - total[i - STEEP]
    level, i, area = total[steepest], steepest, 0.5 * total[steepest]
    if level <= 0.0:
        return BLUR
    while i > 0 and total[i - 1] > LEAST_TAIL * level:
        i -= 1
        area += total[i]
    # For a step of height h that is blurred by sigma, `level` is h / 2, and `area` times the sample distance is h sigma / sqrt(2 pi).
    blur = SAMPLE_STEP * area / level * math.sqrt(0.5 * math.pi)
    blur = math.sqrt(max(0.0, blur * blur - OWN_BLUR * OWN_BLUR))
    return min(blur, MOST_BLUR) if blur > MOST_SHARP_BLUR else BLUR


@njit(cache=True, nogil=True, error_model="numpy")
def scan_outline(
    image: np.ndarray, u: float, v: float, inner: float, outer: float, contrast: float, blur: float = BLUR, every: int = 1
) -> np.ndarray:
    """Find the points of the ball's outline in an image, one along each ray from the ball's centre.

    The edge is where the brightness falls to half of the brightness that is extrapolated from the pixels inside. So the edge is found at
    the right place on a shaded side, too.

    Args:
        image: (h, w) uint8 or uint16.
        u: Column of the ball's centre, pixels.
        v: Row of the ball's centre, pixels.
        inner: Distance from the centre at which the scan for the edge ends, pixels.
        outer: Distance from the centre at which the scan begins, pixels.
        contrast: Difference in grey levels between the brightest part of the ball and the background.
        blur: Sigma of lens and motion at the outline, pixels.
        every: Only one of this many rays is scanned.

    Returns:
        (n,) array of dtype OUTLINE_POINT with `camera` and `frame` 0. Rays along which no edge is found are left out.
    """
    scale = blur_scale(blur)
    step = SAMPLE_STEP * scale
    count = int((outer - inner) / step) + 1
    radius = 0.5 * (inner + outer)
    mean_root = 0.41 * math.sqrt(2.0 * blur / radius)  # mean of sqrt(2 x / radius), if x > 0 is half-normal with scale `blur`
    profile = np.empty(count + INSIDE_SAMPLES)
    points = np.zeros(RAYS, dtype=OUTLINE_POINT)
    found = 0
    for k in range(0, RAYS, every):
        if not sample_ray(image, u, v, k, outer, step, profile):
            continue
        behind = background_behind(profile)
        for i in range(len(profile)):
            profile[i] -= behind
        first = 1
        while first < count and profile[first] < 0.5 * CONTRAST * contrast / BALL_THRESHOLD:
            first += 1
        if first >= count:
            continue
        edge, is_seen, inside = outer - step * first, False, Inside(0, 0.0, 0.0, 0.0)
        for _ in range(2):
            inside = _brightness_inside(profile, edge, outer, radius, scale)
            is_seen = inside.samples >= 4
            if not is_seen:
                break
            target = 0.5 * inside.level + mean_root * inside.slope
            i = max(1, first - 3)
            while i < len(profile) - 1 and profile[i] < target:
                i += 1
            is_steep = profile[i] - profile[i - 1] > 0.0 and i <= first + 5
            is_seen = is_steep and inside.level + EDGE_COSINE * inside.slope > LEAST_BRIGHTNESS * contrast
            if not is_seen:
                break
            edge = edge_crossing(profile, i, target, outer, step)
        if not is_seen:
            continue
        du, dv = ray_direction(k)
        point = points[found]
        point.u, point.v = u + edge * du, v + edge * dv
        point.weight = point_weight(inside.level + EDGE_COSINE * inside.slope, contrast, inside.ragged / SMOOTH)
        found += 1
    return points[:found].copy()


@njit(cache=True, nogil=True, error_model="numpy")
def _brightness_inside(profile: Array, edge: float, outer: float, radius: float, scale: float) -> Inside:
    """Fit the brightness of the ball just inside an edge along one ray.

    Args:
        profile: (n,) grey levels over the background along the ray, from outside inwards.
        edge: Distance of the edge from the ball's centre, pixels.
        outer: Distance of the first sample from the ball's centre, pixels.
        radius: Radius of the ball in the image, pixels.
        scale: Factor on all distances along the ray, from `blur_scale`.
    """
    near, deep, step = scale * INSIDE[0], scale * INSIDE[1], SAMPLE_STEP * scale
    n, sx, sxx, sy, sxy, syy = 0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(max(0, int((outer - edge + near) / step) + 1), min(int((outer - edge + deep) / step), len(profile))):
        x = math.sqrt(
            2.0 * (step * i - outer + edge) / radius
        )  # cosine between normal and line of sight; diffuse brightness is linear in it
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
