"""Position and velocity of the ball from its outlines in all images of a burst at once (in place of dissertation Section 2.2)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from tt_core.constants import BALL_RADIUS, GRAVITY
from tt_core.states import Array

from .camera import Camera, ray, triangulate
from .centre import Image, Spot, outline

EDGE_PRIOR = 0.6  # pixels, by how much an edge found in an image may lie inside or outside the true outline
FINE = 4.0  # pixels on both sides of the expected outline that the second look scans


@dataclass(frozen=True, eq=False)
class Motion:
    """The flight during a burst, `table` frame.

    time: s. position, velocity: (3,) m and m/s at `time`. covariance: (6, 6) of both. acceleration: (3,) m/s^2, held.
    residual: pixels, rms distance of the outline points. offsets: (cameras, 2) pixels, from where the fit puts the ball to where each
    camera has it: the error of the cameras' calibration. points: how many outline points took part.
    """

    time: float
    position: Array
    velocity: Array
    covariance: Array
    acceleration: Array
    residual: float
    offsets: Array
    points: int

    def positions(self, times: Array) -> Array:
        """(n, 3) m at `times` (n,) s."""
        t = np.asarray(times)[:, None] - self.time
        return self.position + t * self.velocity + 0.5 * t * t * self.acceleration


def fit_motion(
    frames: Sequence[Sequence[Image]],
    spots: Sequence[Sequence[Spot]],
    times: Array,
    cameras: Sequence[Camera],
    acceleration: Array = (0.0, 0.0, -GRAVITY),  # type: ignore[assignment]
) -> Motion:
    """Least squares over all outline points, each camera with one unknown edge shift; outliers such as marks on the limb left out.

    frames, spots: [camera][frame], with a whole ball in each. times: (k,) s. acceleration: (3,) m/s^2.
    The outline is where the rays touch the sphere of known radius, so perspective is exact. The state returned is that of the last frame.
    """
    vectors = np.array([camera.vector for camera in cameras])
    tau = np.asarray(times) - np.mean(times)
    gravity = np.array(acceleration, dtype=np.float64)
    state = np.zeros(6 + len(cameras))
    state[:6] = _start(spots, tau, cameras, gravity)
    for reach in (0.35, 0.0):
        points = _outlines(frames, spots, tau, vectors, state, gravity, reach)
        covariance, residual, offsets = _fit(points, vectors, tau, gravity, state)
    last = float(tau[-1])
    move = np.eye(6)
    move[:3, 3:] = last * np.eye(3)
    position = state[:3] + last * state[3:6] + 0.5 * last * last * gravity
    velocity = state[3:6] + last * gravity
    covariance = move @ covariance[:6, :6] @ move.T
    return Motion(float(times[-1]), position, velocity, covariance, gravity, residual, offsets, len(points))


def _start(spots: Sequence[Sequence[Spot]], tau: Array, cameras: Sequence[Camera], gravity: Array) -> Array:
    """(6,) position and velocity at tau = 0 from the rough centres; one camera alone takes the distance from the ball's size."""
    pixels = np.array([[(s.u, s.v) for s in row] for row in spots])
    if len(cameras) > 1:
        at = triangulate(cameras, pixels)
    else:
        rays = cameras[0].rays(pixels[0])
        distance = np.median([cameras[0].focal_pixels * BALL_RADIUS / s.radius for s in spots[0]])
        at = (rays * distance - cameras[0].translation) @ cameras[0].rotation
    basis = np.stack([np.ones_like(tau), tau], axis=1)
    return np.linalg.lstsq(basis, at - 0.5 * tau[:, None] ** 2 * gravity, rcond=None)[0].ravel()


def _outlines(
    frames: Sequence[Sequence[Image]],
    spots: Sequence[Sequence[Spot]],
    tau: Array,
    vectors: Array,
    state: Array,
    gravity: Array,
    reach: float,
) -> Array:
    """(n, 5): camera, frame, pixel and weight of every outline point. reach: relative to the radius; 0 looks only near the outline."""
    found = []
    for c, vector in enumerate(vectors):
        for k, t in enumerate(tau):
            centre = vector[:9].reshape(3, 3) @ (state[:3] + t * state[3:6] + 0.5 * t * t * gravity) + vector[9:12]
            spot = spots[c][k]
            radius = vector[12] * BALL_RADIUS / centre[2]
            u, v = vector[12] * centre[:2] / centre[2] + vector[13:15]
            if reach:
                u, v = spot.u, spot.v
            wide = max(reach * radius, FINE)
            points = outline(frames[c][k], u, v, radius - wide, radius + wide, spot.background, spot.peak)
            found.append(np.hstack([np.full((len(points), 1), c), np.full((len(points), 1), k), points]))
    return np.concatenate(found)


@njit(cache=True, nogil=True)
def residuals(points: Array, vectors: Array, tau: Array, gravity: Array, state: Array) -> tuple[Array, Array, Array]:
    """points: (n, 5) camera, frame, pixel, weight. state: (6 + cameras,) position, velocity at tau = 0, edge shift of each camera.

    Returns (n,) pixels from the outline, outwards; (n, 6 + cameras) its derivative; (n, 2) direction outwards. Not validated.
    """
    n, cameras = len(points), len(vectors)
    r, j, outwards = np.empty(n), np.zeros((n, 6 + cameras)), np.empty((n, 2))
    for i in range(n):
        c, k = int(points[i, 0]), int(points[i, 1])
        camera, t = vectors[c], tau[k]
        f = camera[12]
        x, y = ray(camera, points[i, 2], points[i, 3])
        d = np.array([x, y, 1.0]) / math.sqrt(x * x + y * y + 1.0)
        rotation = camera[:9].copy().reshape(3, 3)
        at = rotation @ (state[:3] + t * state[3:6] + 0.5 * t * t * gravity) + camera[9:12]
        distance = math.sqrt(at @ at)
        towards = at / distance
        across = d - (d @ towards) * towards
        sine = max(1e-12, math.sqrt(across @ across))
        across /= sine
        r[i] = f * (math.atan2(sine, d @ towards) - math.asin(BALL_RADIUS / distance)) - state[6 + c]
        gradient = f / distance * (-across + BALL_RADIUS / math.sqrt(distance**2 - BALL_RADIUS**2) * towards)
        in_table = rotation.T @ gradient
        j[i, :3], j[i, 3:6], j[i, 6 + c] = in_table, t * in_table, -1.0
        length = max(1e-12, math.sqrt(across[0] ** 2 + across[1] ** 2))
        outwards[i, 0], outwards[i, 1] = across[0] / length, across[1] / length
    return r, j, outwards


@njit(cache=True, nogil=True)
def _fit(points: Array, vectors: Array, tau: Array, gravity: Array, state: Array) -> tuple[Array, float, Array]:
    """Gauss-Newton with Tukey's weights; fills `state`, returns its covariance, the rms distance and each camera's offset."""
    size = len(state)
    prior = np.zeros(size)
    prior[6:] = 1.0 / EDGE_PRIOR**2
    scale = 3.0
    for step in range(12):
        r, j, outwards = residuals(points, vectors, tau, gravity, state)
        scale = max(0.08, min(scale, 1.48 * np.median(np.abs(r))))
        w = points[:, 4] * np.maximum(0.0, 1.0 - (r / (4.7 * scale)) ** 2) ** 2
        jw = j * w.reshape(-1, 1) / scale**2
        h = jw.T @ j + np.diag(prior)
        delta = np.linalg.solve(h, jw.T @ r + prior * state)
        state -= delta
        if step > 2 and np.abs(delta[:3]).max() < 1e-7 and np.abs(delta[3:6]).max() < 1e-5:
            break
    rms = math.sqrt((w * r * r).sum() / max(w.sum(), 1e-12))
    offsets = np.zeros((len(vectors), 2))
    for c in range(len(vectors)):
        mine = points[:, 0] == c
        b = outwards[mine]
        bw = b * w[mine].reshape(-1, 1)
        offsets[c] = np.linalg.solve(bw.T @ b + 1e-6 * np.eye(2), bw.T @ r[mine])
    return np.linalg.inv(h), rms, offsets
