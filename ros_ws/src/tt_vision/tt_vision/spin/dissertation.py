"""The methods of the Nagoya dissertation for the ball's centre and spin, as printed, for comparison.

The dissertation is "Racket Control and Spinning Ball Measurement for Table Tennis Robot"; all sections and equations are its own. Method 1
(Section 2.3) and Method 2 (Section 2.4) for the spin take the ball's centre from four points of its outline in each image (Section 2.2).
Method 1 compares black and white images, Method 2 grey levels, both without a correction for the light. What the text does not say is a
parameter with the value used here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.arrays import Array, Image
from tt_core.constants import BALL_RADIUS, RPM
from tt_core.errors import TtError
from tt_core.so3 import rotation_matrix

from ..camera import Camera, triangulate
from ..capture.burst import BallDetection, Burst
from ..detection.outline import BALL_THRESHOLD
from ..projection import project_point, ray, rotate, unpack_camera, unpack_rotation


@dataclass(frozen=True)
class Method2Params:
    """Parameters of the conjugate-gradient search of Method 2 (Section 2.4.2 of the dissertation).

    The search steps over the spin in rad/s, which reproduces the printed numbers of iterations.
    """

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
    """Centre of the ball in each image and in space, by Section 2.2 of the dissertation.

    Attributes:
        pixels: (cameras, frames, 2) pixels, centre of the ball in each image.
        positions: (frames, 3) m in `table`, centre of the ball in each frame.
    """

    pixels: Array
    positions: Array


class MethodResult(NamedTuple):
    """Result of one of the dissertation's two methods for the spin.

    Attributes:
        spin: (3,) rad/s in `table`; 0 if Method 1 found no marks.
        residual: Of Method 2 the error E of (2.32), squared grey levels; of Method 1 the mean cost V of (2.21), 0 to 1.
        iterations: Of Method 2 the iteration number IN of (2.35); of Method 1 the number of pairs of frames that were used.
    """

    spin: Array
    residual: float
    iterations: int


class SquareImages(NamedTuple):
    """The pixels inside the square that is inscribed in the ball, in each frame of one camera.

    Attributes:
        arms: (frames, n, 3) m, vector in the camera's frame from the ball's centre to its surface in each pixel. n is the largest number of
            pixels of a frame; the rest of a frame with fewer pixels is NaN.
        greys: (frames, n) grey level of each pixel; 0 where `arms` is NaN.
    """

    arms: np.ndarray
    greys: np.ndarray


class Shift(NamedTuple):
    """The shift between two square images with the smallest cost.

    Attributes:
        horizontal: Shift to the right, pixels.
        vertical: Shift downwards, pixels.
        cost: The cost V of (2.21) at this shift: share of the overlapping pixels that differ.
    """

    horizontal: int
    vertical: int
    cost: float


def four_points(image: Image, threshold: float) -> Array:
    """Compute the centre of a ball in an image from four points of its outline, (2.5) to (2.10) of the dissertation.

    The image is scanned from each of its four sides for the first pixel over the threshold. The centre is the point nearest to the four
    perpendicular bisectors between neighbouring points. Two details differ from the text. There all scans run along rows, which puts two
    points on one row and makes (2.6) singular; here each scan runs parallel to its own side. And (2.5) minimises the vertical distance to
    the bisectors; here the perpendicular distance is minimised, which is not singular for any slope.

    Args:
        image: (h, w) grey levels.
        threshold: Grey level between the background and the ball.

    Returns:
        (2,) pixels, column and row of the centre.

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
    """Compute the centre of a detected ball in an image from four points of its outline (Section 2.2 of the dissertation).

    Args:
        image: (h, w) grey levels.
        ball: Detection of the ball in this image, which gives the threshold.

    Returns:
        (2,) pixels, column and row of the centre.
    """
    return four_points(image, ball.background + BALL_THRESHOLD * ball.contrast)


def centres_by_four_points(burst: Burst) -> Centres:
    """Compute the centre of the ball in each image and each frame of a burst (Section 2.2 of the dissertation).

    Args:
        burst: A burst (the images of one ball's passage) with cameras, at least two, and detections.
    """
    pixels = np.array(
        [
            [centre_by_four_points(image, ball) for image, ball in zip(stack, row, strict=True)]
            for stack, row in zip(burst.images, burst.detections, strict=True)
        ]
    )
    return Centres(pixels, triangulate(burst.cameras, pixels))


def velocity_by_least_squares(positions: Array, times: Array) -> Array:
    """Fit a straight line to positions by least squares, without gravity (Section 2.2 of the dissertation), and return the velocity.

    Args:
        positions: (k, 3) m in any frame.
        times: (k,) s.

    Returns:
        (3,) m/s in the same frame.
    """
    tau = times - times.mean()
    return np.asarray(tau @ (positions - positions.mean(axis=0)) / (tau @ tau))


def method_2(burst: Burst, params: Method2Params | None = None, trace: list[tuple[float, Array]] | None = None) -> MethodResult:
    """Find the spin by Method 2 of the dissertation: image registration with conjugate gradients (Section 2.4).

    The search uses the components of the spin in `table`, and starts at the printed spin.

    Args:
        burst: A burst (the images of one ball's passage) with cameras, at least two, and detections.
        params: Parameters of the search; None for those of the dissertation.
        trace: List to which the lowest error E so far and its spin (3,) rad/s are appended after each iteration, as Figures 2.17 and 2.18
            show them; None if they are not wanted.
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
    """Cut the pixels of the inscribed square out of each image of one camera; the arguments are not validated.

    Args:
        stack: (k, h, w) float32 grey levels.
        pixels: (k, 2) pixels, centre of the ball in each image.
        centres: (k, 3) m, centre of the ball in the camera's frame.
        camera: (20,) `Camera.vector`.
        half: Half the side of the square, pixels.
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
    """Return the error E of (2.32): the mean squared difference between each frame, rotated by a spin, and the next frame.

    Each rotated point of a frame is assigned to the pixels within one pixel of it (2.27). Each pixel keeps the nearest point (2.31). The
    equations are those of the dissertation.

    Args:
        spin: (3,) rad/s in the camera's frame.
        squares: Pixels of the inscribed squares, from `inscribed_square`.
        stack: (k, h, w) float32 grey levels.
        centres: (k, 3) m, centre of the ball in the camera's frame.
        times: (k,) s.
        camera: (20,) `Camera.vector`.

    Returns:
        Squared grey levels.
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
    """Find the spin by Method 1 of the dissertation: correlation of black and white images (Section 2.3).

    In the binary image a mark (dot on the ball) is 1. A pair of frames is left out unless both frames show marks in all cameras. The result
    is the mean spin of the pairs. A rotation about the line of sight shifts no mark and is not seen; with cameras beside the table this is
    topspin.

    Args:
        burst: A burst (the images of one ball's passage) with cameras, at least two, and detections.
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
    """Return the point of the ball's surface where a line through a point, parallel to the direction to the cameras, leaves the ball.

    If the line misses the ball, it is the point of the surface nearest to the line.

    Args:
        arm: (3,) m, the point relative to the ball's centre.
        towards: (3,) direction to the cameras; its length does not matter.

    Returns:
        (3,) m, relative to the ball's centre.
    """
    d = towards / np.linalg.norm(towards)
    along = arm @ d
    across = arm - along * d
    rest = BALL_RADIUS**2 - across @ across
    return across + math.sqrt(rest) * d if rest > 0.0 else across * (BALL_RADIUS / np.linalg.norm(across))


def _binary(image: Image, ball: BallDetection, pixel: Array) -> np.ndarray:
    """Return the inscribed square of the ball as a binary image (n, n) uint8: 1 where it is darker than half the brightest, a mark."""
    half = int(ball.radius / math.sqrt(2.0))
    u, v = round(float(pixel[0])), round(float(pixel[1]))
    square = image[max(0, v - half) : v + half + 1, max(0, u - half) : u + half + 1]
    return (square < ball.background + 0.5 * ball.contrast).astype(np.uint8)


@njit(cache=True, nogil=True)
def correlate(before: np.ndarray, after: np.ndarray) -> Shift:
    """Find the shift from one binary image to the next with the smallest mean squared difference, (2.21) of the dissertation.

    The limits of the printed sums are interchanged, and they contain no negative shifts. Here shifts of both signs are tried up to half the
    image, so that at least a quarter of it overlaps.

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
    """Return the derivative (2, 3) of a pixel by the position of the point in `table`, pixels/m.

    It is the derivative of (2.12) of the dissertation; the printed (2.14) is not.
    """
    x, y, z = camera.rotation @ point + camera.translation
    return camera.focal_pixels * np.array([[1.0 / z, 0.0, -x / z**2], [0.0, 1.0 / z, -y / z**2]]) @ camera.rotation
