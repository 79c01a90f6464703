"""Detection of the ball in one image: whether it is there, where, and where its centre is (Section 2.2 of the Nagoya dissertation)."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from enum import Enum
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.arrays import Array, Image
from tt_core.errors import BadShape, TtError
from tt_core.failures import Failure

from ..capture.burst import BallDetection, Burst
from .outline import BALL_THRESHOLD, BLUR, CONTRAST, RAYS, blur_scale, scan_outline

SATURATED = 0.2  # share of the ball's pixels at full scale above which the image counts as saturated, because the shading is lost
LEAST_RADIUS = 8.0  # pixels; on a smaller ball the marks cannot be told apart
MOST_RADIUS = 300.0  # pixels; at this radius the measurement of a burst takes 0.8 s, and its time rises with the square of the radius
BACKGROUND_MARGIN = 3.0  # pixels of background that must be visible around the ball
FAR_REACH, NEAR_REACH = 0.35, 4.0  # distance from a circle within which its outline is scanned for: first (of the radius), then (pixels)
FAR_STEP = 2  # at first only one of this many rays is scanned
LEAST_CIRCLE_POINTS = RAYS // 4  # least number of outline points to which a circle is fitted


class DetectionReason(Enum):
    """Reasons why an image does not show a whole ball that can be used; codes of `tt_core.failures.Failure`."""

    BLACK = "black"
    SATURATED = "saturated"
    NO_CONTRAST = "no ball: no contrast"
    TOO_SMALL = "no ball: too small"
    TOO_LARGE = "no ball: too large"
    NOT_ROUND = "no ball: not round"
    NOT_WHOLE = "ball not whole in view"


class NoWholeBall(TtError):
    """An image does not show a whole ball; its failure has a code of DetectionReason."""


class Glance(NamedTuple):
    """Rough measurements of the bright region in an image, which may be a ball.

    Attributes:
        background: Grey level of the background, the median of the image.
        peak: Grey level that one pixel in a thousand exceeds.
        top: Highest grey level.
        at_top: Share of the pixels of the bright region that have the highest grey level.
        u: Column of the centre of the bright region, pixels.
        v: Row of the centre of the bright region, pixels.
        radius: Radius of a ball that has the area of the bright region, pixels.
        left: First column of the bright region; 0 if there is no bright region.
        right: Last column of the bright region.
        upper: First row of the bright region.
        lower: Last row of the bright region.
    """

    background: float
    peak: float
    top: float
    at_top: float
    u: float
    v: float
    radius: float
    left: int
    right: int
    upper: int
    lower: int


def find_ball(image: Image) -> BallDetection:
    """Find the ball in one image.

    This takes 30 us, which is fast enough for every frame of a running camera.

    Args:
        image: (h, w) uint8 or uint16, at least 8 x 8.

    Returns:
        Where the ball is, or why the image does not show a whole ball (`reason`).

    Raises:
        BadShape: The image has another shape or is too small.
        TtError: The image has another type.
    """
    if image.ndim != 2 or min(image.shape) < 8:
        raise BadShape("image", image.shape, "(height, width), at least 8 x 8")
    if image.dtype not in (np.uint8, np.uint16):
        raise TtError(f"image of dtype uint8 or uint16 expected, got {image.dtype}")
    seen = _glance(image)
    full = 2.0 ** max(8, math.ceil(math.log2(seen.top + 1.0))) - 1.0  # of an 8, 10, 12 ... bit camera
    if seen.background >= 0.98 * full:
        return _refused(DetectionReason.SATURATED)
    if seen.peak - seen.background < CONTRAST * full:
        return _refused(DetectionReason.BLACK if seen.peak < CONTRAST * full else DetectionReason.NO_CONTRAST)
    if seen.radius < LEAST_RADIUS:
        return _refused(DetectionReason.TOO_SMALL, radius=seen.radius, bound=LEAST_RADIUS)
    if seen.radius > MOST_RADIUS:
        return _refused(DetectionReason.TOO_LARGE, radius=seen.radius, bound=MOST_RADIUS)
    if seen.top >= full and seen.at_top > SATURATED:
        return _refused(DetectionReason.SATURATED)
    height, width = image.shape
    if (
        min(seen.left, seen.upper) < BACKGROUND_MARGIN
        or seen.right > width - 1 - BACKGROUND_MARGIN
        or seen.lower > height - 1 - BACKGROUND_MARGIN
    ):
        return _refused(DetectionReason.NOT_WHOLE)
    sides = seen.right - seen.left, seen.lower - seen.upper
    if max(sides) > 3.0 * seen.radius or min(sides) < seen.radius:
        return _refused(DetectionReason.NOT_ROUND)
    return BallDetection(None, seen.u, seen.v, seen.radius, seen.background, seen.peak)


def _refused(code: DetectionReason, **values: float) -> BallDetection:
    return BallDetection(Failure(code, **values))


def detect_balls(burst: Burst) -> Burst:
    """Find the ball in every image of a burst, except of cameras for which that has been done before.

    Args:
        burst: The images of one ball's passage through the cameras.

    Returns:
        The same burst with `detections` complete.
    """
    rows = burst.detections or ((),) * len(burst.images)
    found = tuple(row or tuple(find_ball(image) for image in stack) for row, stack in zip(rows, burst.images, strict=True))
    return replace(burst, detections=found)


def first_reason(burst: Burst) -> Failure | None:
    """Return why an image of a burst does not show a whole ball: the reason of the first such image; None if all images show one."""
    return next((one.reason for row in burst.detections for one in row if one.reason), None)


def whole_balls(burst: Burst, most: int) -> tuple[Burst, dict[DetectionReason, int]]:
    """Select the frames of a burst that show the whole ball in all their images.

    Args:
        burst: A burst (the images of one ball's passage) with detections.
        most: Largest number of frames to keep; of more, the last ones are kept.

    Returns:
        The burst of these frames, and the number of frames that do not show the whole ball, by reason.
    """
    reasons = [next((one.reason for one in frame if one.reason), None) for frame in zip(*burst.detections, strict=True)]
    good = [k for k, reason in enumerate(reasons) if reason is None][-most:]
    return burst.only(good), dict(Counter(reason.code for reason in reasons if reason))


def ball_centre(image: Image, *, radius: float | None = None) -> Array:
    """Find the centre of the ball in one image: that of the circle that fits the ball's outline best, without outliers.

    Args:
        image: (h, w) uint8 or uint16.
        radius: Radius of the ball in the image, pixels; None if it is to be fitted, too.

    Returns:
        (2,) pixels, column and row of the centre.

    Raises:
        NoWholeBall: No whole ball is in view.
        TtError: Too few points of an outline were found.
    """
    seen = find_ball(image)
    if seen.reason is not None:
        raise NoWholeBall(seen.reason.code, **seen.reason.values)
    circle = np.array([seen.u, seen.v, seen.radius if radius is None else radius])
    if len(fit_outline(image, circle, seen.contrast, radius is None, BLUR)) < LEAST_CIRCLE_POINTS:
        raise TtError("no outline of the ball")
    return circle[:2]


@njit(cache=True, nogil=True)
def fit_outline(image: np.ndarray, circle: Array, contrast: float, free: bool, blur: float = BLUR) -> np.ndarray:
    """Fit a circle to the ball's outline in an image, and return the points of the outline.

    The outline is scanned twice: far around the given circle, then close to the circle that was fitted first.

    Args:
        image: (h, w) uint8 or uint16.
        circle: (3,) column u and row v of the centre, and radius, pixels: a rough circle, which is replaced in place by the fitted one. It
            stays as it is if too few points are found.
        contrast: Difference in grey levels between the brightest part of the ball and the background.
        free: Whether the radius is fitted, too; if not, it stays as given.
        blur: Sigma of lens and motion at the outline, pixels.

    Returns:
        (n,) array of dtype OUTLINE_POINT with `camera` and `frame` 0: the points of the last scan. It is empty if the fitted circle lies
        outside the ring that was scanned, because then the points do not lie on a circle.
    """
    near = blur_scale(blur) * NEAR_REACH
    for reach, every in ((max(FAR_REACH * circle[2], near), FAR_STEP), (near, 1)):
        points = scan_outline(image, circle[0], circle[1], circle[2] - reach, circle[2] + reach, contrast, blur, every)
        if len(points) < LEAST_CIRCLE_POINTS // every:
            break
        fitted = circle.copy()
        _fit_circle(points, fitted, free)
        if not np.abs(fitted - circle).max() <= reach:
            return points[:0]
        circle[:] = fitted
    return points


@njit(cache=True, nogil=True)
def _fit_circle(points: np.ndarray, circle: Array, free: bool) -> None:
    """Fit a circle to outline points by Gauss-Newton with Tukey's weights.

    Args:
        points: (n,) OUTLINE_POINT.
        circle: (3,) u, v and radius, pixels, where the fit starts; changed in place.
        free: Whether the radius is fitted, too.
    """
    for _ in range(8):
        du, dv = points["u"] - circle[0], points["v"] - circle[1]
        distance = np.sqrt(du * du + dv * dv)
        residual = distance - circle[2]
        scale = max(0.1, 1.48 * np.median(np.abs(residual)))
        j = np.stack((-du / distance, -dv / distance, np.full(len(du), -1.0 if free else 0.0)))
        w = points["weight"] * np.maximum(0.0, 1.0 - (residual / (4.7 * scale)) ** 2) ** 2
        h = (j * w) @ j.T + np.diag(np.array([1e-9, 1e-9, 1e-9]))
        circle -= np.linalg.solve(h, (j * w) @ residual)


@njit(cache=True, nogil=True)
def _glance(image: np.ndarray) -> Glance:
    """Measure the bright region around the median bright pixel of an image, in every second pixel of every second row."""
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
    threshold = int((background + BALL_THRESHOLD * (peak - background)) * (1 << shift))
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
        return Glance(background * scale, peak * scale, float(top), 0.0, 0.0, 0.0, 0.0, 0, 0, 0, 0)
    middle_u, middle_v = _median(columns), _median(rows)
    radius = 1.15 * math.sqrt(4.0 * bright / math.pi)  # 1.15, because a quarter of the disc is dark: marks or shadow
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
    return Glance(background * scale, peak * scale, float(top), part, middle_u, middle_v, radius, u0, u1, v0, v1)


@njit(cache=True, nogil=True)
def _median(counts: np.ndarray) -> int:
    """Return the median of a histogram, in which the number i occurs `counts[i]` times."""
    half, seen, i = counts.sum() // 2, 0, 0
    while seen + counts[i] <= half and i < len(counts) - 1:
        seen += counts[i]
        i += 1
    return i
