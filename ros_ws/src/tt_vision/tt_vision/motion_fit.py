"""Position and velocity of the ball from its outlines in all images of a burst at once (in place of dissertation Section 2.2)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numba import njit
from tt_core.constants import BALL_RADIUS, GRAVITY
from tt_core.errors import TtError
from tt_core.failures import Failure
from tt_core.states import Array

from .camera import Camera, ray, triangulate
from .detection.ball_detection import RAYS, Image, Spot, outline

EDGE_PRIOR = 0.6  # pixels, by how much an edge found in an image may lie inside or outside the true outline
LEAST_POINTS = 16  # in an image: a quarter of the outline
SHADED = (12e-6, 45e-6)  # m, across and along the lines of sight: what all frames share, light that makes one side of an outline brighter
KNOWN = 0.5  # of that when the lamps are known
TRUST = 0.5  # in where the ball is by a second look, where the light at the outline is but extended from what the cameras see within
VAGUE = (
    0.4  # pixels rms of outlines that have no say in where the ball is; 0.1 to 0.3 are usual, 0.8 where one lamp leaves half in the dark
)
THIN = 0.1  # of the acceleration by the air, standard deviation of what is taken for it
DOUBT = 0.1  # pixels, an offset of a camera that is as likely the outlines' as the calibration's
ROUGH = 1.2  # pixels rms of the outline: 0.15 is usual, 0.8 with cameras 1 mm and 0.05 deg out of place, 1.6 with cameras swapped
APART = 3.0  # pixels between what the cameras' calibration and the ball's size promise and what is seen
FAR = 5.0  # pixels from a camera's outlines to where the ball is put; 0.3 is usual where the light is bad
ROUGHLY, ENOUGH = 1e-4, 1e-6  # m, and 1/100 s times that, last step of the first and of later fits: 0.07 pixels, and nothing
FINE = 4.0  # pixels on both sides of the expected outline that the second look scans


class MotionReason(Enum):
    """Why outlines tell no motion of a ball: codes of `tt_core.failures.Failure`."""

    NO_START = "no ball: {error}"
    FEW_POINTS = "no ball: {points} outline points in {images} images"
    NO_SOLUTION = "no ball: the outlines are of no ball that both cameras see"
    FAR_APART = "no ball: the cameras do not see the same ball: {apart:.1f} pixels apart at first sight"
    NOT_FINITE = "no ball: the outlines do not fit"
    ROUGH_OUTLINE = "no ball: outline off by {residual:.2f} pixels rms"
    APART = "the cameras do not see the same ball: {apart:.1f} pixels apart"
    WRONG_SIZE = "no ball: its outline is {edge:.1f} pixels too large or too small"


@dataclass(frozen=True, eq=False)
class Motion:
    """The flight during a burst, `table` frame.

    time: s. position, velocity: (3,) m and m/s at `time`. covariance: (6, 6) of both. acceleration: (3,) m/s^2, held.
    residual: pixels, rms distance of the outline points, each camera aligned. offsets: (cameras, 2) pixels, from where the fit puts the
    ball to where each camera has it: the error of the cameras' calibration. edges: (cameras,) pixels, by which the outline is found too
    far out. points: how many outline points took part.
    """

    time: float
    position: Array
    velocity: Array
    covariance: Array
    acceleration: Array
    residual: float
    offsets: Array
    edges: Array
    points: int

    @property
    def alignment(self) -> Array:
        """(cameras, 2) pixels, the part of `offsets` that is believed."""
        return believed(self.offsets)

    def positions(self, times: Array) -> Array:
        """(n, 3) m at `times` (n,) s."""
        t = np.asarray(times)[:, None] - self.time
        return self.position + t * self.velocity + 0.5 * t * t * self.acceleration

    def bent(self, acceleration: Array, times: Array) -> Motion:
        """The same images, taken at `times` (k,) s, read with another acceleration (3,) m/s^2: the line through its bend is taken off."""
        tau = np.asarray(times) - self.time
        line = np.linalg.lstsq(np.stack([np.ones_like(tau), tau], axis=1), 0.5 * tau * tau, rcond=None)[0]
        more = np.asarray(acceleration) - self.acceleration
        doubt = THIN * np.outer(line, more).ravel()
        return replace(
            self,
            position=self.position - line[0] * more,
            velocity=self.velocity - line[1] * more,
            acceleration=self.acceleration + more,
            covariance=self.covariance + np.outer(doubt, doubt),
        )


def believed(offsets: Array) -> Array:
    """(cameras, 2) pixels, the part of offsets (cameras, 2) that is the calibration's: outlines alone make 0.05, one that is off 0.3."""
    square = (offsets**2).sum(axis=1, keepdims=True)
    return np.asarray(offsets * square / (square + DOUBT**2))


def fit_motion(
    frames: Sequence[Sequence[Image]],
    spots: Sequence[Sequence[Spot]],
    times: Array,
    cameras: Sequence[Camera],
    acceleration: Array = (0.0, 0.0, -GRAVITY),  # type: ignore[assignment]
) -> Motion | Failure:
    """Least squares over all outline points, each camera with one unknown edge shift; outliers such as marks on the limb left out. What a
    camera has aside in all frames alike is taken off in the next fit: a calibration that is off is no motion.

    frames, spots: [camera][frame], with a whole ball in each. times: (k,) s. acceleration: (3,) m/s^2.
    The outline is where the rays touch the sphere of known radius, so perspective is exact. The state returned is that of the last frame.
    Returns the reason when these are no outlines of one ball.
    """
    vectors = np.array([camera.vector for camera in cameras])
    tau = np.asarray(times) - np.mean(times)
    gravity = np.array(acceleration, dtype=np.float64)
    state, offsets = np.zeros(6 + len(cameras)), np.zeros((len(cameras), 2))
    try:
        state[:6] = _start(spots, tau, cameras, gravity)
    except TtError as error:  # the rays of the cameras are parallel
        return Failure(MotionReason.NO_START, error=error)
    for reach, enough in ((0.35, ROUGHLY), (0.0, ENOUGH)):
        points = _outlines(frames, spots, tau, vectors, state, gravity, reach)
        motion = _solved(points, vectors, times, tau, cameras, gravity, state, offsets, False, enough)
        if isinstance(motion, Failure):
            return motion
        offsets = motion.offsets
    return motion


def refit(motion: Motion, points: Array, times: Array, cameras: Sequence[Camera], known: bool) -> Motion | Failure:
    """The same flight by other outline points, (n, 5) camera, frame, pixel and weight. known: whether the lamps are; if not, the outlines
    so far, unless VAGUE, have a say in where the ball is, not in its velocity.
    Returns the reason when these are no outlines of one ball."""
    vectors, tau = np.array([camera.vector for camera in cameras]), np.asarray(times) - np.mean(times)
    state = np.concatenate([motion.positions(np.array([np.mean(times)]))[0], motion.velocity - tau[-1] * motion.acceleration, motion.edges])
    before = state[:3].copy()
    found = _solved(points, vectors, times, tau, cameras, motion.acceleration, state, motion.offsets, known)
    if isinstance(found, Failure):
        return found
    return found if known or motion.residual > VAGUE else replace(found, position=found.position + (1.0 - TRUST) * (before - state[:3]))


def _solved(
    points: Array,
    vectors: Array,
    times: Array,
    tau: Array,
    cameras: Sequence[Camera],
    gravity: Array,
    state: Array,
    offsets: Array,
    known: bool,
    enough: float = ENOUGH,
) -> Motion | Failure:
    """The least squares from `state` (6 + cameras,), which takes the result, and `offsets` as far as they are believed."""
    if len(points) < LEAST_POINTS * len(tau) * len(cameras):
        return Failure(MotionReason.FEW_POINTS, points=len(points), images=len(tau) * len(cameras))
    try:
        covariance, residual, offsets = _fit(points, vectors, tau, gravity, state, believed(offsets), enough)
    except np.linalg.LinAlgError:
        return Failure(MotionReason.NO_SOLUTION)
    if np.abs(offsets).max() > FAR:
        return Failure(MotionReason.FAR_APART, apart=float(np.abs(offsets).max()))
    last = float(tau[-1])
    move = np.eye(6)
    move[:3, 3:] = last * np.eye(3)
    position = state[:3] + last * state[3:6] + 0.5 * last * last * gravity
    velocity = state[3:6] + last * gravity
    covariance = move @ covariance[:6, :6] @ move.T
    across, along = np.array(SHADED) * (KNOWN if known else 1.0)
    sight = np.mean([(position - c.position) / np.linalg.norm(position - c.position) for c in cameras], axis=0)
    covariance[:3, :3] += across**2 * np.eye(3) + (along**2 - across**2) * np.outer(sight, sight) / (sight @ sight)
    found = Motion(float(times[-1]), position, velocity, covariance, gravity, residual, offsets, state[6:].copy(), len(points))
    aside = np.abs(found.alignment).max() * np.linalg.norm(position - cameras[0].position) / cameras[0].focal_pixels
    covariance[:3, :3] += aside**2 * np.eye(3)  # cameras that disagree do not say which of them is wrong
    return found


def doubt(motion: Motion) -> Failure | None:
    """Return why a motion is not to be believed, or None."""
    if not (np.isfinite(motion.position).all() and np.isfinite(motion.velocity).all()):
        return Failure(MotionReason.NOT_FINITE)
    if motion.residual > ROUGH:
        return Failure(MotionReason.ROUGH_OUTLINE, residual=motion.residual)
    apart, edge = float(np.abs(motion.offsets).max()), float(np.abs(motion.edges).max())
    if apart > APART:
        return Failure(MotionReason.APART, apart=apart)
    return Failure(MotionReason.WRONG_SIZE, edge=edge) if edge > APART else None


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
    return np.asarray(np.linalg.lstsq(basis, at - 0.5 * tau[:, None] ** 2 * gravity, rcond=None)[0].ravel(), dtype=np.float64)


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
    out, n, t = np.empty((len(vectors) * len(tau) * RAYS, 5)), 0, tau[:, None]
    balls = state[:3] + t * state[3:6] + 0.5 * t * t * gravity
    for c, vector in enumerate(vectors):
        centres = balls @ vector[:9].reshape(3, 3).T + vector[9:12]
        scales = vector[12] / centres[:, 2]
        pixels = scales[:, None] * centres[:, :2] + vector[13:15]
        for k, (spot, (u, v), radius) in enumerate(zip(spots[c], pixels.tolist(), (BALL_RADIUS * scales).tolist(), strict=True)):
            if reach:
                u, v = spot.u, spot.v
            wide = max(reach * radius, FINE)
            points = outline(frames[c][k], u, v, radius - wide, radius + wide, spot.background, spot.peak)
            out[n : n + len(points), 0], out[n : n + len(points), 1], out[n : n + len(points), 2:] = c, k, points
            n += len(points)
    return out[:n]


@njit(cache=True, nogil=True, error_model="numpy")
def bearings(points: Array, vectors: Array) -> Array:
    """(n, 3) unit vectors to outline points (n, 5), as `distances` takes them, in their camera's frame."""
    out = np.empty((len(points), 3))
    for i in range(len(points)):
        x, y = ray(vectors[int(points[i, 0])], points[i, 2], points[i, 3])
        scale = 1.0 / math.sqrt(x * x + y * y + 1.0)
        out[i, 0], out[i, 1], out[i, 2] = x * scale, y * scale, scale
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def distances(points: Array, rays: Array, vectors: Array, tau: Array, gravity: Array, state: Array) -> tuple[Array, Array, Array]:
    """points: (n, 5) camera, frame, pixel, weight. rays: (n, 3), their `bearings`. state: (6 + cameras,) position,
    velocity at tau = 0, edge shift of each camera.

    Returns (n,) pixels from the expected outline, outwards; (n, 6) its derivative by position and velocity (by the camera's own edge shift
    it is -1); (n, 2) the direction outwards in the image. Not validated.
    """
    n = len(points)
    r, j, outwards = np.empty(n), np.empty((n, 6)), np.empty((n, 2))
    px = py = pz = limb = factor = distance = 0.0
    last_c, last_k = -1, -1
    for i in range(n):
        c, k = int(points[i, 0]), int(points[i, 1])
        camera, t = vectors[c], tau[k]
        if c != last_c or k != last_k:
            last_c, last_k = c, k
            bx = state[0] + t * (state[3] + 0.5 * t * gravity[0])
            by = state[1] + t * (state[4] + 0.5 * t * gravity[1])
            bz = state[2] + t * (state[5] + 0.5 * t * gravity[2])
            px = camera[0] * bx + camera[1] * by + camera[2] * bz + camera[9]
            py = camera[3] * bx + camera[4] * by + camera[5] * bz + camera[10]
            pz = camera[6] * bx + camera[7] * by + camera[8] * bz + camera[11]
            distance = math.sqrt(px * px + py * py + pz * pz)
            px, py, pz = px / distance, py / distance, pz / distance
            limb = math.asin(BALL_RADIUS / distance)
            factor = BALL_RADIUS / math.sqrt(distance * distance - BALL_RADIUS * BALL_RADIUS)
        dx, dy, dz = rays[i, 0], rays[i, 1], rays[i, 2]
        cosine = dx * px + dy * py + dz * pz
        ax, ay, az = dx - cosine * px, dy - cosine * py, dz - cosine * pz
        sine = max(1e-12, math.sqrt(ax * ax + ay * ay + az * az))
        ax, ay, az = ax / sine, ay / sine, az / sine
        r[i] = camera[12] * (math.atan2(sine, cosine) - limb) - state[6 + c]
        f = camera[12] / distance
        gx, gy, gz = f * (factor * px - ax), f * (factor * py - ay), f * (factor * pz - az)
        for a in range(3):
            j[i, a] = camera[a] * gx + camera[3 + a] * gy + camera[6 + a] * gz
            j[i, 3 + a] = t * j[i, a]
        length = max(1e-12, math.sqrt(ax * ax + ay * ay))
        outwards[i, 0], outwards[i, 1] = ax / length, ay / length
    return r, j, outwards


@njit(cache=True, nogil=True, error_model="numpy")
def _fit(
    points: Array, vectors: Array, tau: Array, gravity: Array, state: Array, aside: Array, enough: float
) -> tuple[np.ndarray, float, np.ndarray]:
    """Gauss-Newton with Tukey's weights until a step is shorter than `enough` m, each camera's points moved back by `aside` (cameras, 2);
    fills `state`, returns its covariance, the rms distance with each camera aligned, the offsets."""
    size, n, cameras = len(state), len(points), len(vectors)
    scale = 3.0
    w, rays = np.empty(n), bearings(points, vectors)
    h, g, row, of = np.empty((size, size)), np.empty(size), np.empty(7), np.empty((cameras, 7, 7))
    row[6] = -1.0
    for step in range(12):
        r, j, outwards = distances(points, rays, vectors, tau, gravity, state)
        for i in range(n):
            c = int(points[i, 0])
            r[i] -= aside[c, 0] * outwards[i, 0] + aside[c, 1] * outwards[i, 1]
        scale = max(0.05, min(scale, 1.48 * np.median(np.abs(r))))
        h[:], g[:], of[:] = 0.0, 0.0, 0.0
        for c in range(6, size):
            h[c, c], g[c] = 1.0 / EDGE_PRIOR**2, state[c] / EDGE_PRIOR**2
        for i in range(n):
            out = r[i] / (4.7 * scale)
            w[i] = points[i, 4] * max(0.0, 1.0 - out * out) ** 2
            if w[i] == 0.0:
                continue
            row[:6] = j[i]
            c = int(points[i, 0])
            force = w[i] / (scale * scale)
            for a in range(7):
                pull = force * row[a]
                g[a if a < 6 else 6 + c] += pull * r[i]
                for b in range(a + 1):
                    of[c, a, b] += pull * row[b]
        for c in range(cameras):
            for a in range(7):
                for b in range(a + 1):
                    p, q = a if a < 6 else 6 + c, b if b < 6 else 6 + c
                    h[p, q] += of[c, a, b]
                    h[q, p] = h[p, q]
        delta = np.linalg.solve(h, g)
        state -= delta
        if step > 2 and np.abs(delta[:3]).max() < enough and np.abs(delta[3:6]).max() < 100.0 * enough:
            break
    m, b2 = np.zeros((cameras, 3)), np.zeros((cameras, 2))
    for i in range(n):
        c = int(points[i, 0])
        x, y = outwards[i]
        m[c, 0] += w[i] * x * x
        m[c, 1] += w[i] * x * y
        m[c, 2] += w[i] * y * y
        b2[c, 0] += w[i] * x * r[i]
        b2[c, 1] += w[i] * y * r[i]
    offsets = np.zeros((cameras, 2))
    for c in range(cameras):
        det = m[c, 0] * m[c, 2] - m[c, 1] ** 2 + 1e-9
        offsets[c, 0] = (m[c, 2] * b2[c, 0] - m[c, 1] * b2[c, 1]) / det
        offsets[c, 1] = (m[c, 0] * b2[c, 1] - m[c, 1] * b2[c, 0]) / det
    error, total = 0.0, 1e-12
    for i in range(n):
        c = int(points[i, 0])
        rest = r[i] - offsets[c, 0] * outwards[i, 0] - offsets[c, 1] * outwards[i, 1]
        error += w[i] * rest * rest
        total += w[i]
    return np.linalg.inv(h) * (error / total / scale**2), math.sqrt(error / total), aside + offsets
