"""The ball in one image: is it there, where is its outline, where is its centre (dissertation Section 2.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt
from numba import njit
from tt_core.errors import BadShape, TtError
from tt_core.failures import Failure
from tt_core.states import Array

Image = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

RAYS = 64  # outline points looked for in one image
DEPTH = 0.25  # threshold between background and brightest part of the ball, relative
CONTRAST = 0.06  # least contrast of a ball, relative to full scale: 15 of 255 grey levels
SATURATED = 0.2  # part of the ball at full scale from which shading is lost
LEAST_RADIUS = 8.0  # pixels, of a ball whose marks can be told apart
MOST_RADIUS = 300.0  # pixels: to measure a burst takes 0.8 s there, and time rises with the square
SMOOTH = 0.04  # relative deviation of the brightness along a ray from diffuse light that halves its weight twice: a mark
BLUR = 0.7  # pixels, sigma of lens and motion at the outline; the outline moves by 0.02 pixels when this is off by 0.3
MARGIN = 3.0  # pixels of background wanted around the ball


class DetectionReason(Enum):
    """Why an image is not used: codes of `tt_core.failures.Failure`."""

    BLACK = "black"
    SATURATED = "saturated"
    NO_CONTRAST = "no ball: no contrast"
    TOO_SMALL = "no ball: too small"
    TOO_LARGE = "no ball: too large"
    NOT_ROUND = "no ball: not round"
    NOT_WHOLE = "ball not whole in view"


class NoWholeBall(TtError):
    """An image does not show a whole ball."""

    def __init__(self, reason: Failure) -> None:
        """Keep the reason, so that a caller can decide on its code."""
        super().__init__(str(reason))
        self.reason = reason


@dataclass(frozen=True)
class Spot:
    """What a glance at one image tells.

    reason: None when a whole ball is in view. u, v, radius: pixels, rough (2 pixels). background, peak: grey levels.
    """

    reason: Failure | None
    u: float = 0.0
    v: float = 0.0
    radius: float = 0.0
    background: float = 0.0
    peak: float = 0.0


def find_ball(image: Image) -> Spot:
    """A glance at one image, (h, w) uint8 or uint16: 30 us, cheap enough for every frame of a running camera."""
    if image.ndim != 2 or min(image.shape) < 8:
        raise BadShape("image", image.shape, "(height, width), at least 8 x 8")
    if image.dtype not in (np.uint8, np.uint16):
        raise TtError(f"image of dtype uint8 or uint16 expected, got {image.dtype}")
    background, peak, top, at_top, u, v, radius, u0, u1, v0, v1 = _glance(image)
    full = 2.0 ** max(8, math.ceil(math.log2(top + 1.0))) - 1.0  # of an 8, 10, 12 ... bit camera
    if background >= 0.98 * full:
        return _refused(DetectionReason.SATURATED)
    if peak - background < CONTRAST * full:
        return _refused(DetectionReason.BLACK if peak < CONTRAST * full else DetectionReason.NO_CONTRAST)
    if radius < LEAST_RADIUS:
        return _refused(DetectionReason.TOO_SMALL, radius=radius, bound=LEAST_RADIUS)
    if radius > MOST_RADIUS:
        return _refused(DetectionReason.TOO_LARGE, radius=radius, bound=MOST_RADIUS)
    if top >= full and at_top > SATURATED:
        return _refused(DetectionReason.SATURATED)
    height, width = image.shape
    if min(u0, v0) < MARGIN or u1 > width - 1 - MARGIN or v1 > height - 1 - MARGIN:
        return _refused(DetectionReason.NOT_WHOLE)
    if max(u1 - u0, v1 - v0) > 3.0 * radius or min(u1 - u0, v1 - v0) < radius:
        return _refused(DetectionReason.NOT_ROUND)
    return Spot(None, u, v, radius, background, peak)


def _refused(code: DetectionReason, **values: float) -> Spot:
    return Spot(Failure(code, **values))


@njit(cache=True, nogil=True)
def _glance(image: np.ndarray) -> tuple[float, float, float, float, float, float, float, float, float, float, float]:
    """Every second pixel of every second row. Grey levels, part of the bright pixels at the highest level, middle, radius and box of the
    bright region around the median bright pixel."""
    height, width = image.shape
    top = 0
    for v in range(0, height, 2):
        for u in range(0, width, 2):
            top = max(top, image[v, u])
    shift = 0
    while top >> shift > 255:
        shift += 1
    histogram = np.zeros(256, dtype=np.int64)
    for v in range(0, height, 2):
        for u in range(0, width, 2):
            histogram[image[v, u] >> shift] += 1
    total = histogram.sum()
    seen, level = 0, 0
    while seen + histogram[level] < total // 2:
        seen += histogram[level]
        level += 1
    background = level
    seen, level = 0, 255
    while seen + histogram[level] < 0.001 * total:
        seen += histogram[level]
        level -= 1
    peak = level
    threshold = int((background + DEPTH * (peak - background)) * (1 << shift))
    columns, rows = np.zeros(width, dtype=np.int64), np.zeros(height, dtype=np.int64)
    bright = 0
    for v in range(0, height, 2):
        for u in range(0, width, 2):
            if image[v, u] > threshold:
                columns[u] += 1
                rows[v] += 1
                bright += 1
    scale = 1.0 * (1 << shift)
    if bright == 0:
        return background * scale, peak * scale, float(top), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    middle_u, middle_v = _median(columns), _median(rows)
    radius = 1.15 * math.sqrt(4.0 * bright / math.pi)  # a quarter of the disc is marked or in shadow
    reach = 1.5 * radius + 2.0
    u0, u1, v0, v1 = width, 0, height, 0
    count, at_top = 0, 0
    for v in range(max(0, 2 * int((middle_v - reach) / 2)), min(height, int(middle_v + reach)), 2):
        for u in range(max(0, 2 * int((middle_u - reach) / 2)), min(width, int(middle_u + reach)), 2):
            if image[v, u] > threshold:
                count += 1
                u0, u1, v0, v1 = min(u0, u), max(u1, u), min(v0, v), max(v1, v)
                if image[v, u] >= top:
                    at_top += 1
    radius = 1.15 * math.sqrt(4.0 * count / math.pi)
    middle_u, middle_v = 0.5 * (u0 + u1), 0.5 * (v0 + v1)
    part = at_top / max(count, 1)
    return background * scale, peak * scale, float(top), part, middle_u, middle_v, radius, u0, u1, v0, v1


@njit(cache=True, nogil=True)
def _median(counts: np.ndarray) -> int:
    half, seen, i = counts.sum() // 2, 0, 0
    while seen + counts[i] <= half and i < len(counts) - 1:
        seen += counts[i]
        i += 1
    return i


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def bilinear(image: np.ndarray, u: float, v: float) -> float:
    """Inside the image only; not validated."""
    i, j = int(u), int(v)
    a, b = u - i, v - j
    return (1.0 - b) * ((1.0 - a) * image[j, i] + a * image[j, i + 1]) + b * ((1.0 - a) * image[j + 1, i] + a * image[j + 1, i + 1])


@njit(cache=True, nogil=True, error_model="numpy")
def outline(image: np.ndarray, u: float, v: float, inner: float, outer: float, background: float, peak: float) -> Array:
    """Points of the outline of the ball.

    u, v: pixels, its centre. inner, outer: pixels, where to look for the edge, from outside. background, peak: grey levels.
    Returns (n, 3): pixel and weight. The edge is where the brightness falls to half of what the two to five pixels inside extrapolate to,
    so that a shaded side counts like a bright one. Not validated.
    """
    step = 0.5
    count = int((outer - inner) / step) + 1
    deep = 12  # samples within the edge that tell the brightness at the edge
    radius = 0.5 * (inner + outer)
    spread = 0.41 * math.sqrt(2.0 * BLUR / radius)  # mean of sqrt(2 x / radius) over a normal x > 0 of sigma BLUR
    profile = np.empty(count + deep)
    height, width = image.shape
    points = np.empty((RAYS, 3))
    found = 0
    for k in range(RAYS):
        du, dv = math.cos(2.0 * math.pi * k / RAYS), math.sin(2.0 * math.pi * k / RAYS)
        if not (0.0 <= u + outer * du < width - 1 and 0.0 <= v + outer * dv < height - 1):
            continue
        for i in range(count + deep):
            s = outer - step * i
            profile[i] = bilinear(image, u + s * du, v + s * dv)
        behind = 0.25 * (profile[0] + profile[1] + profile[2] + profile[3])  # the background here, which may be unlike that elsewhere
        for i in range(count + deep):
            profile[i] -= behind
        first = 1
        while first < count and profile[first] < 0.5 * CONTRAST * (peak - background) / 0.25:
            first += 1
        if first >= count:
            continue
        s, seen, ragged = outer - step * first, False, 0.0
        for _ in range(2):
            n, sx, sxx, sy, sxy, syy = 0, 0.0, 0.0, 0.0, 0.0, 0.0
            for i in range(max(0, int((outer - s + 1.5) / step) + 1), min(int((outer - s + 6.0) / step), count + deep)):
                x = math.sqrt(2.0 * (step * i - outer + s) / radius)  # cosine to the line of sight: diffuse light is linear in it
                y = profile[i]
                n, sx, sxx, sy, sxy, syy = n + 1, sx + x, sxx + x * x, sy + y, sxy + x * y, syy + y * y
            seen = n >= 4
            if not seen:
                break
            slope = max(0.0, (n * sxy - sx * sy) / (n * sxx - sx * sx))
            level = (sy - slope * sx) / n
            if level < 0.0:
                level, slope = 0.0, sy / sx
            target = 0.5 * level + spread * slope
            ragged = math.sqrt(max(0.0, syy - level * sy - slope * sxy) / n) / max(level + 0.4 * slope, 1e-9)
            i = max(1, first - 3)
            while i < count + deep - 1 and profile[i] < target:
                i += 1
            rise = profile[i] - profile[i - 1]
            seen = rise > 0.0 and i <= first + 5 and level + 0.4 * slope > 0.15 * (peak - background)
            if not seen:
                break
            s = outer - step * (i - (profile[i] - target) / rise)
        if not seen:
            continue
        level += 0.4 * slope
        points[found, 0], points[found, 1] = u + s * du, v + s * dv
        points[found, 2] = min(1.0, level / (0.5 * (peak - background))) / (1.0 + (ragged / SMOOTH) ** 2) ** 2
        found += 1
    return points[:found].copy()


def centre(image: Image, *, radius: float | None = None, method: str = "contour") -> Array:
    """(2,) pixel, the middle of the ball's outline in one image, (h, w) uint8 or uint16.

    radius: pixels, when known. method: "contour", a circle through the outline, outliers left out; "liu", the four points and their
    perpendicular bisectors of the dissertation. Raises NoWholeBall with the reason when no whole ball is in view.
    """
    spot = find_ball(image)
    if spot.reason is not None:
        raise NoWholeBall(spot.reason)
    if method == "liu":
        return four_points(image, spot.background + DEPTH * (spot.peak - spot.background))
    if method != "contour":
        raise TtError(f"method {method!r} is neither 'contour' nor 'liu'")
    about = spot.radius if radius is None else radius
    circle = np.array([spot.u, spot.v, about])
    for reach in (0.35 * about, 4.0):
        points = outline(image, circle[0], circle[1], circle[2] - reach, circle[2] + reach, spot.background, spot.peak)
        if len(points) < RAYS // 4:
            raise TtError("no outline of the ball")
        _fit_circle(points, circle, radius is None)
    return circle[:2]


@njit(cache=True, nogil=True)
def _fit_circle(points: Array, circle: Array, free: bool) -> None:
    """Gauss-Newton on the distances to the outline, Tukey's weights from the median distance; fills circle (u, v, radius)."""
    for _ in range(8):
        du, dv = points[:, 0] - circle[0], points[:, 1] - circle[1]
        distance = np.sqrt(du * du + dv * dv)
        residual = distance - circle[2]
        scale = max(0.1, 1.48 * np.median(np.abs(residual)))
        j = np.stack((-du / distance, -dv / distance, np.full(len(du), -1.0 if free else 0.0)))
        w = points[:, 2] * np.maximum(0.0, 1.0 - (residual / (4.7 * scale)) ** 2) ** 2
        h = (j * w) @ j.T + np.diag(np.array([1e-9, 1e-9, 1e-9]))
        circle -= np.linalg.solve(h, (j * w) @ residual)


def four_points(image: Image, threshold: float) -> Array:
    """(2,) pixel, (2.5) to (2.10): the point nearest to the four perpendicular bisectors between the first points over `threshold` that
    scans from the four sides meet.

    The text's scans all run along rows, which puts two points on one row and makes (2.6) singular: here each scan runs along its own
    side. (2.5) minimises the vertical distance to the bisectors: here it is the perpendicular distance, which no slope makes singular.
    """
    over = image > threshold
    rows, columns = np.flatnonzero(over.any(axis=1)), np.flatnonzero(over.any(axis=0))
    if len(rows) == 0:
        raise TtError("no ball: nothing over the threshold")
    top, bottom, left, right = rows[0], rows[-1], columns[0], columns[-1]
    points = np.array(
        [
            (np.flatnonzero(over[top])[0], top),
            (right, np.flatnonzero(over[:, right])[0]),
            (np.flatnonzero(over[bottom])[-1], bottom),
            (left, np.flatnonzero(over[:, left])[-1]),
        ],
        dtype=np.float64,
    )
    chords = np.roll(points, -1, axis=0) - points
    chords /= np.maximum(np.linalg.norm(chords, axis=1, keepdims=True), 1e-9)
    middles = (points + np.roll(points, -1, axis=0)) / 2
    return np.linalg.lstsq(chords, (chords * middles).sum(axis=1), rcond=None)[0]
