"""The dissertation's own ways to the centre and the spin of the ball, as printed, to compare with.

Method 1 (Section 2.3) and Method 2 (Section 2.4) take the ball's centre from four points on its outline, frame by frame (Section 2.2), and
grey levels or black and white as they come. What the text leaves open is a parameter with the value used here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.constants import BALL_RADIUS, RPM
from tt_core.errors import TtError
from tt_core.so3 import rotation_matrix
from tt_core.states import Array

from ..camera import Camera, triangulate
from ..capture.burst import BallDetection, Burst, Image
from ..detection.outline import DEPTH
from ..projection import project_point, ray, rotate, unpack_camera, unpack_rotation


@dataclass(frozen=True)
class Method2Params:
    """Parameters of the search of Section 2.4.2. The spin is in rad/s there, which reproduces the printed iteration counts."""

    camera: int = 1  # index of the camera whose images are compared, "say Camera 2"
    start: tuple[float, float, float] = (577.35, -577.35, 577.35)  # rpm, Section 2.5
    step: float = 20.0  # alpha_0^0, Section 2.4.2
    least_step: float = 0.5  # alpha_min, Section 2.5
    enough: float = 1000.0  # E_min, squared grey levels, Section 2.5
    flat: float = 3.0  # g_max, Section 2.5
    searches: int = 4  # q_max, Section 2.5
    directions: int = 6  # h_max, Section 2.5
    difference: float = 10.0  # rad/s, of the central difference; not printed, and E has steps
    descent: float = 0.1  # Wolfe-Powell, sufficient decrease; not printed
    curvature: float = 0.7  # Wolfe-Powell, weak curvature; not printed


class Centres(NamedTuple):
    """Where the ball is in each frame, Section 2.2.

    Attributes:
        pixels: (cameras, frames, 2), the middle of the ball in each image.
        positions: (frames, 3) m in `table`.
    """

    pixels: Array
    positions: Array


class MethodResult(NamedTuple):
    """What one of the methods finds.

    Attributes:
        spin: (3,) rad/s in `table`.
        residual: E (2.32) of Method 2, mean V (2.21) of Method 1.
        iterations: Iteration number IN (2.35) of Method 2, pairs of frames used by Method 1.
    """

    spin: Array
    residual: float
    iterations: int


class SquareImages(NamedTuple):
    """The pixels of the inscribed square of each frame of a burst.

    Attributes:
        arms: (k, n, 3) m from the ball's centre to the surface in the camera's frame, NaN behind the last pixel of a frame.
        greys: (k, n) grey levels.
    """

    arms: np.ndarray
    greys: np.ndarray


class Shift(NamedTuple):
    """The shift between two squares with the smallest cost V (2.21), pixels."""

    horizontal: int
    vertical: int
    cost: float


def four_points(image: Image, threshold: float) -> Array:
    """Return the middle of a ball from four points of its outline, (2.5) to (2.10).

    It is the point nearest to the four perpendicular bisectors between the first points over the threshold that scans from the four sides
    meet. The scans of the text all run along rows, which puts two points on one row and makes (2.6) singular: here each scan runs along
    its own side. (2.5) minimises the vertical distance to the bisectors: here it is the perpendicular distance, which no slope makes
    singular.

    Args:
        image: (h, w).
        threshold: Grey level.

    Returns:
        (2,) pixel.

    Raises:
        TtError: No pixel is over the threshold.
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


def centre_by_four_points(image: Image, ball: BallDetection) -> Array:
    """Return the middle (2,) pixel of a ball that has been detected in an image, Section 2.2."""
    return four_points(image, ball.background + DEPTH * ball.contrast)


def centres_by_four_points(burst: Burst) -> Centres:
    """Return where the ball is in each image and frame of a burst with detections, Section 2.2."""
    pixels = np.array(
        [
            [centre_by_four_points(image, ball) for image, ball in zip(stack, row, strict=True)]
            for stack, row in zip(burst.images, burst.detections, strict=True)
        ]
    )
    return Centres(pixels, triangulate(burst.cameras, pixels))


def velocity_by_least_squares(positions: Array, times: Array) -> Array:
    """Return the velocity (3,) m/s of the straight line through positions (k, 3) m at times (k,) s, without gravity, Section 2.2."""
    tau = times - times.mean()
    return np.asarray(tau @ (positions - positions.mean(axis=0)) / (tau @ tau))


def method_2(burst: Burst, params: Method2Params | None = None, trace: list[tuple[float, Array]] | None = None) -> MethodResult:
    """Find the spin by image registration with conjugate gradients (Section 2.4).

    The search runs in `table`, with the printed start.

    Args:
        burst: A burst with detections.
        params: Of the search.
        trace: Takes E and the spin after each iteration, as Figures 2.17 and 2.18 show them.
    """
    p = params or Method2Params()
    camera = burst.cameras[p.camera]
    pixels, positions = centres_by_four_points(burst)
    centres = positions @ camera.rotation.T + camera.translation
    images = burst.images[p.camera]
    full = max(255.0, 2.0 ** math.ceil(math.log2(float(images.max()) + 1.0)) - 1.0)
    stack = np.float32(255.0 / full) * images.astype(np.float32)  # E_min is meant for 8 bits
    half = 0.5 * math.sqrt(2.0) * camera.focal_pixels * BALL_RADIUS / float(centres[:, 2].mean())  # of the inscribed square
    squares = inscribed_square(stack, pixels[p.camera], centres, camera.vector, half)

    def objective(spin: Array) -> float:
        return difference(camera.rotation @ spin, squares, stack, centres, burst.times, camera.vector)

    def gradient(spin: Array) -> Array:
        return np.array([(objective(spin + e) - objective(spin - e)) / (2.0 * p.difference) for e in p.difference * np.eye(3)])

    spin = RPM * np.array(p.start)
    error, g, direction, step, iterations = objective(spin), gradient(spin), np.zeros(3), p.step, 0
    before = g
    for h in range(p.directions):
        beta = 0.0 if h == 0 else min(1.0, max(0.0, float(g @ (g - before)) / max(float(before @ before), 1e-12)))  # Polak-Ribiere-Polyak
        direction = -g + beta * direction
        slope = float(g @ direction)
        if slope >= 0.0:
            direction, slope = -g, -float(g @ g)
        low, high = 0.0, math.inf
        for _ in range(p.searches):
            iterations += 1
            trial = spin + step * direction
            trial_error = objective(trial)
            if trace is not None:
                trace.append(min((error, spin), (trial_error, trial), key=lambda each: each[0]))
            if trial_error > error + p.descent * step * slope:
                high = step
            else:
                trial_gradient = gradient(trial)
                if trial_gradient @ direction >= p.curvature * slope:
                    break
                low = step
            step = 2.0 * low if high == math.inf else 0.5 * (low + high)
            if step < p.least_step:
                break
        if trial_error < error:
            before, spin, error = g, trial, trial_error
            g = gradient(spin)
        if step < p.least_step or (error < p.enough and np.linalg.norm(g) < p.flat):
            break
    return MethodResult(spin, error, iterations)


@njit(cache=True, nogil=True)
def inscribed_square(stack: np.ndarray, pixels: Array, centres: Array, camera: Array, half: float) -> SquareImages:
    """Return the pixels of the square inscribed in the ball. Not validated.

    Args:
        stack: (k, h, w) float32.
        pixels: (k, 2), the middle of the ball.
        centres: (k, 3) m in the camera's frame.
        camera: `Camera.vector`.
        half: Pixels, half the side of the square.
    """
    optics = unpack_camera(camera).optics
    side = int(2.0 * half) + 2
    arms, greys = np.full((len(stack), side * side, 3), np.nan), np.zeros((len(stack), side * side))
    for k in range(len(stack)):
        cx, cy, cz = centres[k]
        square = cx * cx + cy * cy + cz * cz - BALL_RADIUS**2
        n = 0
        for j in range(max(0, math.ceil(pixels[k, 1] - half)), min(stack.shape[1], int(pixels[k, 1] + half) + 1)):
            for i in range(max(0, math.ceil(pixels[k, 0] - half)), min(stack.shape[2], int(pixels[k, 0] + half) + 1)):
                x, y = ray(optics, i, j)
                scale = 1.0 / math.sqrt(x * x + y * y + 1.0)
                along = (x * cx + y * cy + cz) * scale
                gap = along * along - square
                if gap > 0.0:
                    reach = (along - math.sqrt(gap)) * scale
                    arms[k, n, 0], arms[k, n, 1], arms[k, n, 2] = reach * x - cx, reach * y - cy, reach - cz
                    greys[k, n] = stack[k, j, i]
                    n += 1
    return SquareImages(arms, greys)


@njit(cache=True, nogil=True)
def difference(spin: Array, squares: SquareImages, stack: np.ndarray, centres: Array, times: Array, camera: Array) -> float:
    """Return E (2.32), squared grey levels, of each frame turned on by a spin against the next one.

    Every point that is moved is given to the pixels nearer than one pixel (2.27); each pixel keeps the nearest point (2.31).

    Args:
        spin: (3,) rad/s in the camera's frame.
        squares: From `inscribed_square`.
        stack: (k, h, w) float32.
        centres: (k, 3) m in the camera's frame.
        times: (k,) s.
        camera: `Camera.vector`.
    """
    optics, (arms, greys) = unpack_camera(camera).optics, squares
    height, width = stack.shape[1], stack.shape[2]
    nearest, value = np.empty((height, width)), np.empty((height, width))
    total = 0.0
    for k in range(len(times) - 1):
        turn = unpack_rotation(rotation_matrix(spin * (times[k + 1] - times[k])))
        cx, cy, cz = centres[k + 1]
        u, v = project_point(optics, cx, cy, cz)
        reach = optics.focal * BALL_RADIUS / cz + 3.0
        u0, u1 = max(0, int(u - reach)), min(width, int(u + reach) + 1)
        v0, v1 = max(0, int(v - reach)), min(height, int(v + reach) + 1)
        nearest[v0:v1, u0:u1] = 1.0
        for n in range(arms.shape[1]):
            x, y, z = arms[k, n, 0], arms[k, n, 1], arms[k, n, 2]
            if math.isnan(x):
                break
            dx, dy, dz = rotate(turn, x, y, z)
            u, v = project_point(optics, cx + dx, cy + dy, cz + dz)
            for j in range(max(v0, math.ceil(v - 1.0)), min(v1, int(v + 1.0) + 1)):
                for i in range(max(u0, math.ceil(u - 1.0)), min(u1, int(u + 1.0) + 1)):
                    square = (i - u) ** 2 + (j - v) ** 2
                    if square < nearest[j, i]:
                        nearest[j, i], value[j, i] = square, greys[k, n]
        count, error = 0, 0.0
        for j in range(v0, v1):
            for i in range(u0, u1):
                if nearest[j, i] < 1.0:
                    count += 1
                    error += (value[j, i] - stack[k + 1, j, i]) ** 2
        total += error / max(count, 1)
    return total / (len(times) - 1)


def method_1(burst: Burst) -> MethodResult:
    """Find the spin by correlation of black and white squares (Section 2.3).

    The marks are 1 in the binary image. A pair of frames without marks in both cameras is left out; the spin is the mean over the pairs. A
    turn about the line of sight shifts nothing and is not seen: with cameras beside the table that is topspin.

    Args:
        burst: A burst with detections.
    """
    times, cameras = burst.times, burst.cameras
    pixels, positions = centres_by_four_points(burst)
    squares = [[_binary(*each) for each in zip(*rows, strict=True)] for rows in zip(burst.images, burst.detections, pixels, strict=True)]
    towards = np.mean([camera.position for camera in cameras], axis=0) - positions.mean(axis=0)
    spins, costs = [], []
    for k in range(len(times) - 1):
        if not all(squares[c][k].any() and squares[c][k + 1].any() for c in range(len(cameras))):
            continue
        shifts, marks = [], []
        for c in range(len(cameras)):
            h, v, cost = correlate(squares[c][k], squares[c][k + 1])
            shifts += [h, v]
            costs.append(cost)
            rows, columns = np.nonzero(squares[c][k])
            half = (len(squares[c][k]) - 1) / 2
            marks.append(pixels[c, k] + [columns.mean() - half, rows.mean() - half])  # (2.23)
        arm = _onto_surface(triangulate(cameras, np.array(marks)[:, None])[0] - positions[k], towards)
        turn = np.array([[0.0, -arm[2], arm[1]], [arm[2], 0.0, -arm[0]], [-arm[1], arm[0], 0.0]])
        image = np.concatenate([_image_jacobian(camera, positions[k] + arm) for camera in cameras])
        spins.append(np.linalg.pinv(-image @ turn) @ np.array(shifts) / (times[k + 1] - times[k]))  # (2.19)
    if not spins:
        return MethodResult(np.zeros(3), 1.0, 0)
    return MethodResult(np.mean(spins, axis=0), float(np.mean(costs)), len(spins))


def _onto_surface(arm: Array, towards: Array) -> Array:
    """Return where the line through `arm` towards the cameras leaves the ball, (3,) m from the centre, or the nearest point to it."""
    d = towards / np.linalg.norm(towards)
    along = arm @ d
    across = arm - along * d
    rest = BALL_RADIUS**2 - across @ across
    return across + math.sqrt(rest) * d if rest > 0.0 else across * (BALL_RADIUS / np.linalg.norm(across))


def _binary(image: Image, ball: BallDetection, pixel: Array) -> np.ndarray:
    """Return the inscribed square, (n, n) uint8: 1 for marks, which are darker than half the brightest."""
    half = int(ball.radius / math.sqrt(2.0))
    u, v = round(float(pixel[0])), round(float(pixel[1]))
    square = image[max(0, v - half) : v + half + 1, max(0, u - half) : u + half + 1]
    return (square < ball.background + 0.5 * ball.contrast).astype(np.uint8)


@njit(cache=True, nogil=True)
def correlate(before: np.ndarray, after: np.ndarray) -> Shift:
    """Return the shift from `before` to `after` with the smallest mean squared difference (2.21).

    The printed sums swap their limits and have no negative shift; here both signs are tried up to half the square, so that at least a
    quarter of it overlaps.

    Args:
        before: (n, n) uint8, 0 or 1.
        after: (n, n) uint8, 0 or 1.
    """
    n, m = min(before.shape[0], after.shape[0]), min(before.shape[1], after.shape[1])
    best, best_h, best_v = math.inf, 0, 0
    for v in range(-(n // 2), n // 2 + 1):
        for h in range(-(m // 2), m // 2 + 1):
            error = 0
            for t in range(max(0, v), min(n, n + v)):
                for s in range(max(0, h), min(m, m + h)):
                    error += 1 if after[t, s] != before[t - v, s - h] else 0
            mean = error / ((n - abs(v)) * (m - abs(h)))
            if mean < best:
                best, best_h, best_v = mean, h, v
    return Shift(best_h, best_v, best)


def _image_jacobian(camera: Camera, point: Array) -> Array:
    """Return the derivative (2, 3) of (2.12), pixels by m in `table`; (2.14) should show it and does not."""
    x, y, z = camera.rotation @ point + camera.translation
    return camera.focal_pixels * np.array([[1.0 / z, 0.0, -x / z**2], [0.0, 1.0 / z, -y / z**2]]) @ camera.rotation
