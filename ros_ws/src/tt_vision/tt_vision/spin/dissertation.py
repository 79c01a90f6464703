"""The dissertation's own two ways to the spin, as printed, to compare with: Method 1 (Section 2.3) and Method 2 (Section 2.4).

Both take the ball's centre from four points on its outline, frame by frame (Section 2.2), and grey levels or black and white as they come.
What the text leaves open is a parameter with the value used here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from tt_core.constants import BALL_RADIUS, RPM
from tt_core.so3 import rotation_matrix
from tt_core.states import Array

from ..camera import Camera, project_point, ray, triangulate
from ..detection.ball_detection import DEPTH, Image, Spot, four_points


@dataclass(frozen=True)
class Method2Params:
    """Of the search of Section 2.4.2; spin in rad/s, which reproduces the printed iteration counts."""

    camera: int = 1  # "say Camera 2"
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


def centres_by_four_points(
    frames: Sequence[Sequence[Image]], spots: Sequence[Sequence[Spot]], cameras: Sequence[Camera]
) -> tuple[Array, Array]:
    """((cameras, frames, 2) pixels, (frames, 3) m in `table`), Section 2.2."""
    pixels = np.array(
        [
            [four_points(image, spot.background + DEPTH * (spot.peak - spot.background)) for image, spot in zip(images, row, strict=True)]
            for images, row in zip(frames, spots, strict=True)
        ]
    )
    return pixels, triangulate(cameras, pixels)


def velocity_by_least_squares(positions: Array, times: Array) -> Array:
    """(3,) m/s of the straight line through positions (k, 3) m at times (k,) s, without gravity, Section 2.2."""
    tau = times - times.mean()
    return np.asarray(tau @ (positions - positions.mean(axis=0)) / (tau @ tau))


def method_2(
    frames: Sequence[Sequence[Image]],
    spots: Sequence[Sequence[Spot]],
    times: Array,
    cameras: Sequence[Camera],
    params: Method2Params | None = None,
    trace: list[tuple[float, Array]] | None = None,
) -> tuple[Array, float, int]:
    """Image registration by conjugate gradients: (spin (3,) rad/s in `table`, E, iteration number IN (2.35)).

    The search runs in `table`, with the printed start. trace: takes E and spin after each iteration, as Figures 2.17 and 2.18 show them.
    """
    p = params or Method2Params()
    camera = cameras[p.camera]
    pixels, positions = centres_by_four_points(frames, spots, cameras)
    centres = positions @ camera.rotation.T + camera.translation
    images = np.asarray(frames[p.camera])
    full = max(255.0, 2.0 ** math.ceil(math.log2(float(images.max()) + 1.0)) - 1.0)
    stack = np.float32(255.0 / full) * images.astype(np.float32)  # E_min is meant for 8 bits
    half = 0.5 * math.sqrt(2.0) * camera.focal_pixels * BALL_RADIUS / float(centres[:, 2].mean())  # of the inscribed square
    arms, greys = inscribed_square(stack, pixels[p.camera], centres, camera.vector, half)

    def objective(spin: Array) -> float:
        return difference(camera.rotation @ spin, arms, greys, stack, centres, times, camera.vector)

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
    return spin, error, iterations


@njit(cache=True, nogil=True)
def inscribed_square(stack: np.ndarray, pixels: Array, centres: Array, camera: Array, half: float) -> tuple[np.ndarray, np.ndarray]:
    """((k, n, 3) m from the ball's centre in the camera's frame, (k, n) grey levels) of the pixels in the inscribed square, NaN off it.

    stack: (k, h, w) float32. pixels: (k, 2), centres: (k, 3) m in the camera's frame. half: pixels, half the square. Not validated.
    """
    side = int(2.0 * half) + 2
    arms, greys = np.full((len(stack), side * side, 3), np.nan), np.zeros((len(stack), side * side))
    for k in range(len(stack)):
        cx, cy, cz = centres[k]
        square = cx * cx + cy * cy + cz * cz - BALL_RADIUS**2
        n = 0
        for j in range(max(0, math.ceil(pixels[k, 1] - half)), min(stack.shape[1], int(pixels[k, 1] + half) + 1)):
            for i in range(max(0, math.ceil(pixels[k, 0] - half)), min(stack.shape[2], int(pixels[k, 0] + half) + 1)):
                x, y = ray(camera, i, j)
                scale = 1.0 / math.sqrt(x * x + y * y + 1.0)
                along = (x * cx + y * cy + cz) * scale
                gap = along * along - square
                if gap > 0.0:
                    reach = (along - math.sqrt(gap)) * scale
                    arms[k, n, 0], arms[k, n, 1], arms[k, n, 2] = reach * x - cx, reach * y - cy, reach - cz
                    greys[k, n] = stack[k, j, i]
                    n += 1
    return arms, greys


@njit(cache=True, nogil=True)
def difference(spin: Array, arms: np.ndarray, greys: np.ndarray, stack: np.ndarray, centres: Array, times: Array, camera: Array) -> float:
    """E (2.32), squared grey levels: each frame moved on by `spin` (rad/s, camera's frame) against the next one.

    arms, greys: `inscribed_square`. Every point moved is given to the pixels nearer than one (2.27), each pixel keeps its nearest (2.31).
    """
    height, width = stack.shape[1], stack.shape[2]
    nearest, value = np.empty((height, width)), np.empty((height, width))
    total = 0.0
    for k in range(len(times) - 1):
        turn = rotation_matrix(spin * (times[k + 1] - times[k]))
        cx, cy, cz = centres[k + 1]
        u, v = project_point(camera, cx, cy, cz)
        reach = camera[12] * BALL_RADIUS / cz + 3.0
        u0, u1 = max(0, int(u - reach)), min(width, int(u + reach) + 1)
        v0, v1 = max(0, int(v - reach)), min(height, int(v + reach) + 1)
        nearest[v0:v1, u0:u1] = 1.0
        for n in range(arms.shape[1]):
            x, y, z = arms[k, n, 0], arms[k, n, 1], arms[k, n, 2]
            if math.isnan(x):
                break
            u, v = project_point(
                camera,
                cx + turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z,
                cy + turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z,
                cz + turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z,
            )
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


def method_1(
    frames: Sequence[Sequence[Image]], spots: Sequence[Sequence[Spot]], times: Array, cameras: Sequence[Camera]
) -> tuple[Array, float, int]:
    """Correlation of black and white squares: (spin (3,) rad/s in `table`, mean V (2.21), pairs of frames used).

    The marks are 1 in the binary image. A pair without marks in both cameras is left out; the spin is the mean over pairs. A turn about the
    line of sight shifts nothing and is not seen: with cameras beside the table that is topspin.
    """
    pixels, positions = centres_by_four_points(frames, spots, cameras)
    squares = [[_binary(*each) for each in zip(*rows, strict=True)] for rows in zip(frames, spots, pixels, strict=True)]
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
        return np.zeros(3), 1.0, 0
    return np.mean(spins, axis=0), float(np.mean(costs)), len(spins)


def _onto_surface(arm: Array, towards: Array) -> Array:
    """(3,) m from the centre: where the line through `arm` to the cameras leaves the ball, or its nearest point to it."""
    d = towards / np.linalg.norm(towards)
    along = arm @ d
    across = arm - along * d
    rest = BALL_RADIUS**2 - across @ across
    return across + math.sqrt(rest) * d if rest > 0.0 else across * (BALL_RADIUS / np.linalg.norm(across))


def _binary(image: Image, spot: Spot, pixel: Array) -> np.ndarray:
    """(n, n) uint8 of the inscribed square: 1 for marks, darker than half the brightest."""
    half = int(spot.radius / math.sqrt(2.0))
    u, v = round(float(pixel[0])), round(float(pixel[1]))
    square = image[max(0, v - half) : v + half + 1, max(0, u - half) : u + half + 1]
    return (square < spot.background + 0.5 * (spot.peak - spot.background)).astype(np.uint8)


@njit(cache=True, nogil=True)
def correlate(before: np.ndarray, after: np.ndarray) -> tuple[int, int, float]:
    """(horizontal, vertical, V): the shift in pixels from `before` to `after` with the smallest mean squared difference (2.21).

    The printed sums swap their limits and know no negative shift; here both signs are tried up to half the square, so that at least a
    quarter of it overlaps.
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
    return best_h, best_v, best


def _image_jacobian(camera: Camera, point: Array) -> Array:
    """(2, 3) pixels by m in `table`, the derivative of (2.12), which (2.14) should show."""
    x, y, z = camera.rotation @ point + camera.translation
    return camera.focal_pixels * np.array([[1.0 / z, 0.0, -x / z**2], [0.0, 1.0 / z, -y / z**2]]) @ camera.rotation
