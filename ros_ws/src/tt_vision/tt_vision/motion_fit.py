"""Position and velocity of the ball from its outlines in all images of a burst at once (in place of dissertation Section 2.2).

The outline of a sphere of known radius is where rays touch it, so perspective is exact. Unknown are the position and the velocity of the
ball, and by how much each camera finds the edge too far out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.constants import BALL_RADIUS, GRAVITY
from tt_core.failures import Failure
from tt_core.states import Array

from .camera import CannotTriangulate, triangulate
from .capture.burst import Burst
from .detection.outline import scan_outline
from .projection import CameraModel, ray, rotate_back, to_camera, unpack_camera

EDGE_PRIOR = 0.6  # pixels, standard deviation of how far inside or outside the true outline an edge is found in an image
LEAST_POINTS = 16  # outline points needed in an image: a quarter of the outline
LIGHT_ERROR = (
    12e-6,
    45e-6,
)  # m, across and along the lines of sight: what light that brightens one side of an outline shifts in all frames
CALIBRATED_LIGHT = 0.5  # times LIGHT_ERROR with calibrated lamps
REFIT_TRUST = 0.5  # weight of the refitted position, because the light at the outline is extrapolated from what the cameras see within
VAGUE_OUTLINE = 0.4  # pixels rms, of first outlines that have no say in the refitted position; 0.1 to 0.3 are usual, 0.8 half in the dark
AIR_ERROR = 0.1  # of the acceleration by the air, standard deviation of what is taken for it
OFFSET_ERROR = 0.1  # pixels, an offset of a camera that is as likely the outlines' as the calibration's
LITTLE_ASIDE = 0.02  # pixels, an alignment that moves the ball by less than the noise
MOST_OFFSET = 5.0  # pixels from a camera's outlines to where the ball is put, that a fit may have; 0.3 is usual where the light is bad
LEAST_STEP = 1e-6  # m, and 1/100 s times that: last step of a fit; no pixel notices it
FIRST_LEAST_STEP = 1e-4  # the same of the first fit: 0.07 pixels
FIRST_REACH = 0.35  # of the radius: how far from the rough outline the first fit scans for it
FINE_REACH = 4.0  # pixels, how far from the expected outline later fits scan for it
MOST_RESIDUAL = 1.2  # pixels rms of the outline: 0.15 is usual, 0.8 with cameras 1 mm and 0.05 deg out of place, 1.6 with cameras swapped
MOST_APART = 3.0  # pixels between what the cameras' calibration and the ball's size promise and what is seen
MOST_EDGE = 2.0  # pixels by which a camera may see the ball too large: 1.4 with 3 pixels of blur, 2.4 with the camera 10 cm out of place
FALL = (0.0, 0.0, -GRAVITY)  # m/s^2
STEPS = 12  # of a fit, at most
TUKEY = 4.7  # standard deviations beyond which a point has no weight


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
class BallMotion:
    """The flight during a burst, in `table`.

    Attributes:
        time: s, of the last frame.
        position: (3,) m at `time`.
        velocity: (3,) m/s at `time`.
        covariance: (6, 6) of position and velocity.
        acceleration: (3,) m/s^2, taken as constant.
        residual: Pixels, rms distance of the outline points, each camera aligned.
        offsets: (cameras, 2) pixels, from where the fit puts the ball to where each camera has it: the error of the cameras' calibration.
        edges: (cameras,) pixels, by which the outline is found too far out.
        points: Number of outline points.
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
        """The part of `offsets` that is taken as the calibration's, (cameras, 2) pixels."""
        return calibration_part(self.offsets)

    def positions(self, times: Array) -> Array:
        """Return the positions (n, 3) m at times (n,) s."""
        t = np.asarray(times)[:, None] - self.time
        return self.position + t * self.velocity + 0.5 * t * t * self.acceleration

    def at_distance(self, place: Array, factor: float) -> BallMotion:
        """Return the motion that looks the same from `place` (3,) m but is `factor` times as far away."""
        return replace(self, position=place + factor * (self.position - place), velocity=factor * self.velocity)

    def with_acceleration(self, acceleration: Array, times: Array) -> BallMotion:
        """Return the motion that the same images tell if the ball has another acceleration.

        Args:
            acceleration: (3,) m/s^2.
            times: (k,) s, of the images. The straight line that fits the change of the path at these times is taken off.
        """
        tau = np.asarray(times) - self.time
        line = np.linalg.lstsq(np.stack([np.ones_like(tau), tau], axis=1), 0.5 * tau * tau, rcond=None)[0]
        more = np.asarray(acceleration) - self.acceleration
        sigma = AIR_ERROR * np.outer(line, more).ravel()
        return replace(
            self,
            position=self.position - line[0] * more,
            velocity=self.velocity - line[1] * more,
            acceleration=self.acceleration + more,
            covariance=self.covariance + np.outer(sigma, sigma),
        )


class FitSetup(NamedTuple):
    """What a fit takes as given.

    Attributes:
        vectors: (cameras, 20) `Camera.vector` of each camera.
        tau: (frames,) s, times of the frames from their mean on.
        acceleration: (3,) m/s^2.
    """

    vectors: Array
    tau: Array
    acceleration: Array


class FitState(NamedTuple):
    """Position (m) and velocity (m/s) of the ball at tau = 0: the first six unknowns of a fit. An edge shift of each camera follows."""

    x: float
    y: float
    z: float
    vx: float
    vy: float
    vz: float


class Distances(NamedTuple):
    """Outline points beside the outline that a state promises.

    Attributes:
        outwards: (n,) pixels, distance of each point from the outline, outwards.
        jacobian: (n, 6), derivative by position and velocity. By the edge shift of the point's own camera it is -1.
        directions: (n, 2), unit direction outwards in the image.
    """

    outwards: Array
    jacobian: Array
    directions: Array


class Fit(NamedTuple):
    """What a fit leaves beside the state.

    Attributes:
        covariance: (6 + cameras, 6 + cameras) of the state.
        residual: Pixels rms, each camera aligned.
        offsets: (cameras, 2) pixels, see BallMotion.
    """

    covariance: np.ndarray
    residual: float
    offsets: Array


def calibration_part(offsets: Array) -> Array:
    """Return the part of offsets (cameras, 2) pixels that is taken as the calibration's.

    The errors of outlines alone make 0.05 pixels, a calibration that is off makes 0.3.
    """
    square = (offsets**2).sum(axis=1, keepdims=True)
    return np.asarray(offsets * square / (square + OFFSET_ERROR**2))


def fit_motion(burst: Burst, acceleration: Array = FALL) -> BallMotion | Failure:  # type: ignore[assignment]
    """Fit the motion of the ball to its outlines in all images.

    Least squares over all outline points, twice, with one unknown edge shift for each camera. Outliers, such as marks at the limb, are left
    out. What a camera is off in all frames alike is taken off in the second fit: an error of the calibration is no motion.

    Args:
        burst: A burst with cameras and detections, of which every image shows the whole ball.
        acceleration: (3,) m/s^2.

    Returns:
        The motion, or the reason why there is none.
    """
    setup = _setup(burst, np.array(acceleration, dtype=np.float64))
    state, offsets = np.zeros(6 + len(burst.cameras)), np.zeros((len(burst.cameras), 2))
    circles = np.array([[(ball.u, ball.v, ball.radius) for ball in row] for row in burst.detections])
    try:
        state[:6] = _start(burst, setup, circles)
    except CannotTriangulate as error:
        return Failure(MotionReason.NO_START, error=error)
    points = _first_outlines(burst, setup, state)
    motion = _solve(points, burst, setup, state, offsets, least_step=FIRST_LEAST_STEP)
    if isinstance(motion, Failure):
        return motion
    return _solve(_fine_outlines(burst, setup, state), burst, setup, state, motion.offsets)


def fit_motion_to_outlines(burst: Burst, points: np.ndarray, circles: Array) -> BallMotion | Failure:
    """Fit the motion of the ball to outline points that were found image by image, while the frames came.

    Args:
        burst: A burst with cameras and detections, of which every image shows the whole ball.
        points: (n,) OUTLINE_POINT of all images, those of one image one after the other.
        circles: (cameras, frames, 3) pixels, u, v and radius of the ball in each image.

    Returns:
        The motion, or the reason why there is none.
    """
    setup = _setup(burst, np.array(FALL))
    state, offsets = np.zeros(6 + len(burst.cameras)), np.zeros((len(burst.cameras), 2))
    try:
        state[:6] = _start(burst, setup, circles)
    except CannotTriangulate as error:
        return Failure(MotionReason.NO_START, error=error)
    motion = _solve(points, burst, setup, state, offsets)
    if isinstance(motion, Failure) or np.abs(motion.alignment).max() < LITTLE_ASIDE:
        return motion
    return _solve(points, burst, setup, state, motion.offsets)


def refit_motion(motion: BallMotion, points: np.ndarray, burst: Burst, is_light_calibrated: bool) -> BallMotion | Failure:
    """Fit the motion to other outline points of the same burst.

    Args:
        motion: The motion so far.
        points: (n,) OUTLINE_POINT.
        burst: The burst.
        is_light_calibrated: Whether the points were found by the light of calibrated lamps. If not, the outlines so far have a say in the
            position, unless they are vague.

    Returns:
        The motion, or the reason why there is none.
    """
    setup = _setup(burst, motion.acceleration)
    middle = motion.positions(np.array([np.mean(burst.times)]))[0]
    state = np.concatenate([middle, motion.velocity - setup.tau[-1] * motion.acceleration, motion.edges])
    found = _solve(points, burst, setup, state, motion.offsets, is_light_calibrated=is_light_calibrated)
    if isinstance(found, Failure) or is_light_calibrated or motion.residual > VAGUE_OUTLINE:
        return found
    return replace(found, position=found.position + (1.0 - REFIT_TRUST) * (middle - state[:3]))


def motion_doubt(motion: BallMotion) -> Failure | None:
    """Return why a motion is not to be believed, or None."""
    if not (np.isfinite(motion.position).all() and np.isfinite(motion.velocity).all()):
        return Failure(MotionReason.NOT_FINITE)
    if motion.residual > MOST_RESIDUAL:
        return Failure(MotionReason.ROUGH_OUTLINE, residual=motion.residual, bound=MOST_RESIDUAL)
    apart, edge = float(np.abs(motion.offsets).max()), float(np.abs(motion.edges).max())
    if apart > MOST_APART:
        return Failure(MotionReason.APART, apart=apart, bound=MOST_APART)
    return Failure(MotionReason.WRONG_SIZE, edge=edge, bound=MOST_EDGE) if edge > MOST_EDGE else None


def _setup(burst: Burst, acceleration: Array) -> FitSetup:
    return FitSetup(np.array([camera.vector for camera in burst.cameras]), burst.from_middle, acceleration)


def _solve(
    points: np.ndarray,
    burst: Burst,
    setup: FitSetup,
    state: Array,
    offsets: Array,
    *,
    is_light_calibrated: bool = False,
    least_step: float = LEAST_STEP,
) -> BallMotion | Failure:
    """Fit from a state (6 + cameras,), which takes the result, each camera aligned by its offsets as far as they are the calibration's."""
    tau, cameras = setup.tau, burst.cameras
    if len(points) < LEAST_POINTS * len(tau) * len(cameras):
        return Failure(MotionReason.FEW_POINTS, points=len(points), images=len(tau) * len(cameras))
    try:
        fit = _fit(points, setup, state, calibration_part(offsets), least_step)
    except np.linalg.LinAlgError:
        return Failure(MotionReason.NO_SOLUTION)
    apart = float(np.abs(fit.offsets).max())
    if apart > MOST_OFFSET:
        return Failure(MotionReason.FAR_APART, apart=apart, bound=MOST_OFFSET)
    last = float(tau[-1])
    move = np.eye(6)
    move[:3, 3:] = last * np.eye(3)
    position = state[:3] + last * state[3:6] + 0.5 * last * last * setup.acceleration
    velocity = state[3:6] + last * setup.acceleration
    covariance = move @ fit.covariance[:6, :6] @ move.T
    across, along = np.array(LIGHT_ERROR) * (CALIBRATED_LIGHT if is_light_calibrated else 1.0)
    sight = np.mean([(position - c.position) / np.linalg.norm(position - c.position) for c in cameras], axis=0)
    covariance[:3, :3] += across**2 * np.eye(3) + (along**2 - across**2) * np.outer(sight, sight) / (sight @ sight)
    motion = BallMotion(
        time=float(burst.times[-1]),
        position=position,
        velocity=velocity,
        covariance=covariance,
        acceleration=setup.acceleration,
        residual=fit.residual,
        offsets=fit.offsets,
        edges=state[6:].copy(),
        points=len(points),
    )
    aside = np.abs(motion.alignment).max() * np.linalg.norm(position - cameras[0].position) / cameras[0].focal_pixels
    covariance[:3, :3] += aside**2 * np.eye(3)  # cameras that disagree do not say which of them is wrong
    return motion


def _start(burst: Burst, setup: FitSetup, circles: Array) -> Array:
    """Return position and velocity (6,) at tau = 0 from the rough circles; one camera alone takes the distance from the ball's size."""
    pixels = circles[..., :2]
    if len(burst.cameras) > 1:
        at = triangulate(burst.cameras, pixels)
    else:
        camera = burst.cameras[0]
        distance = np.median(camera.focal_pixels * BALL_RADIUS / circles[0, :, 2])
        at = (camera.rays(pixels[0]) * distance - camera.translation) @ camera.rotation
    tau = setup.tau
    basis = np.stack([np.ones_like(tau), tau], axis=1)
    return np.asarray(np.linalg.lstsq(basis, at - 0.5 * tau[:, None] ** 2 * setup.acceleration, rcond=None)[0].ravel(), dtype=np.float64)


def _first_outlines(burst: Burst, setup: FitSetup, state: Array) -> np.ndarray:
    """Return the outline points (n,) OUTLINE_POINT far around where the ball was detected."""
    found = []
    for c, row in enumerate(burst.detections):
        for k, (ball, circle) in enumerate(zip(row, _circles(setup, state, c), strict=True)):
            reach = max(FIRST_REACH * circle[2], FINE_REACH)
            points = scan_outline(burst.images[c][k], ball.u, ball.v, circle[2] - reach, circle[2] + reach, ball.contrast)
            points["camera"], points["frame"] = c, k
            found.append(points)
    return np.concatenate(found)


def _fine_outlines(burst: Burst, setup: FitSetup, state: Array) -> np.ndarray:
    """Return the outline points (n,) OUTLINE_POINT near where a state promises them."""
    found = []
    for c, row in enumerate(burst.detections):
        for k, (ball, (u, v, radius)) in enumerate(zip(row, _circles(setup, state, c), strict=True)):
            points = scan_outline(burst.images[c][k], u, v, radius - FINE_REACH, radius + FINE_REACH, ball.contrast)
            points["camera"], points["frame"] = c, k
            found.append(points)
    return np.concatenate(found)


@njit(cache=True, nogil=True, error_model="numpy")
def _circles(setup: FitSetup, state: Array, c: int) -> list[tuple[float, float, float]]:
    """Return middle (u, v) and radius, pixels, of the ball in each frame of camera c, by a state; the lens is taken as straight."""
    camera, flight, out = unpack_camera(setup.vectors[c]), unpack_state(state), []
    for t in setup.tau:
        x, y, z = to_camera(camera, *ball_at(flight, setup.acceleration, t))
        scale = camera.optics.focal / z
        out.append((scale * x + camera.optics.u0, scale * y + camera.optics.v0, BALL_RADIUS * scale))
    return out


@njit(cache=True, nogil=True, forceinline=True)
def unpack_state(state: Array) -> FitState:
    """Return position and velocity of a state (6 + cameras,)."""
    return FitState(state[0], state[1], state[2], state[3], state[4], state[5])


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def ball_at(s: FitState, acceleration: Array, t: float) -> tuple[float, float, float]:
    """Return the ball's position, m, at t s after tau = 0."""
    return (
        s.x + t * (s.vx + 0.5 * t * acceleration[0]),
        s.y + t * (s.vy + 0.5 * t * acceleration[1]),
        s.z + t * (s.vz + 0.5 * t * acceleration[2]),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def bearings(points: np.ndarray, vectors: Array) -> Array:
    """Return the unit directions (n, 3) to outline points (n,) OUTLINE_POINT in their camera's frame. vectors: as in FitSetup."""
    out = np.empty((len(points), 3))
    for i in range(len(points)):
        point = points[i]
        x, y = ray(unpack_camera(vectors[point.camera]).optics, point.u, point.v)
        scale = 1.0 / math.sqrt(x * x + y * y + 1.0)
        out[i, 0], out[i, 1], out[i, 2] = x * scale, y * scale, scale
    return out


class Silhouette(NamedTuple):
    """A ball as one camera sees it in one frame.

    Attributes:
        px: Unit vector (px, py, pz) to its centre in the camera's frame; so are `py` and `pz`.
        py: See `px`.
        pz: See `px`.
        distance: m.
        limb: rad, half the angle that it fills.
        factor: Tangent of `limb`.
    """

    px: float
    py: float
    pz: float
    distance: float
    limb: float
    factor: float


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def _silhouette(camera: CameraModel, ball: tuple[float, float, float]) -> Silhouette:
    px, py, pz = to_camera(camera, ball[0], ball[1], ball[2])
    distance = math.sqrt(px * px + py * py + pz * pz)
    factor = BALL_RADIUS / math.sqrt(distance * distance - BALL_RADIUS * BALL_RADIUS)
    return Silhouette(px / distance, py / distance, pz / distance, distance, math.asin(BALL_RADIUS / distance), factor)


@njit(cache=True, nogil=True, error_model="numpy")
def distances(points: np.ndarray, rays: Array, setup: FitSetup, state: Array) -> Distances:
    """Compare outline points with the outline that a state promises. Not validated.

    Args:
        points: (n,) OUTLINE_POINT, those of one image one after the other.
        rays: (n, 3), their `bearings`.
        setup: Cameras, times and acceleration.
        state: (6 + cameras,) position and velocity at tau = 0, and the edge shift of each camera, pixels.
    """
    n, flight = len(points), unpack_state(state)
    r, j, directions = np.empty(n), np.empty((n, 6)), np.empty((n, 2))
    seen, t = Silhouette(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.0
    camera = unpack_camera(setup.vectors[0])
    last_c, last_k = -1, -1
    for i in range(n):
        c, k = points[i].camera, points[i].frame
        if c != last_c or k != last_k:
            last_c, last_k = c, k
            camera, t = unpack_camera(setup.vectors[c]), setup.tau[k]
            seen = _silhouette(camera, ball_at(flight, setup.acceleration, t))
        dx, dy, dz = rays[i, 0], rays[i, 1], rays[i, 2]
        cosine = dx * seen.px + dy * seen.py + dz * seen.pz
        ax, ay, az = dx - cosine * seen.px, dy - cosine * seen.py, dz - cosine * seen.pz
        sine = max(1e-12, math.sqrt(ax * ax + ay * ay + az * az))
        ax, ay, az = ax / sine, ay / sine, az / sine
        r[i] = camera.optics.focal * (math.atan2(sine, cosine) - seen.limb) - state[6 + c]
        f = camera.optics.focal / seen.distance
        gx, gy, gz = f * (seen.factor * seen.px - ax), f * (seen.factor * seen.py - ay), f * (seen.factor * seen.pz - az)
        j[i, 0], j[i, 1], j[i, 2] = rotate_back(camera.rotation, gx, gy, gz)
        for a in range(3):
            j[i, 3 + a] = t * j[i, a]
        length = max(1e-12, math.sqrt(ax * ax + ay * ay))
        directions[i, 0], directions[i, 1] = ax / length, ay / length
    return Distances(r, j, directions)


@njit(cache=True, nogil=True, error_model="numpy")
def _fit(points: np.ndarray, setup: FitSetup, state: Array, aside: Array, least_step: float) -> Fit:
    """Fit a state, in place, by Gauss-Newton with Tukey's weights, until a step is shorter than `least_step` m.

    Args:
        points: (n,) OUTLINE_POINT.
        setup: Cameras, times and acceleration.
        state: (6 + cameras,), see `distances`.
        aside: (cameras, 2) pixels, by which the points of each camera are moved back.
        least_step: m, and 1/100 s times that.
    """
    size, cameras = len(state), len(setup.vectors)
    scale = 3.0
    w, rays = np.zeros(len(points)), bearings(points, setup.vectors)
    r, directions = np.empty(0), np.empty((0, 2))
    h, g, of_camera = np.empty((size, size)), np.empty(size), np.empty((cameras, 7, 7))
    for step in range(STEPS):
        r, j, directions = distances(points, rays, setup, state)
        for i in range(len(points)):
            c = points[i].camera
            r[i] -= aside[c, 0] * directions[i, 0] + aside[c, 1] * directions[i, 1]
        scale = max(0.05, min(scale, 1.48 * np.median(np.abs(r))))
        for i in range(len(points)):
            out = r[i] / (TUKEY * scale)
            w[i] = points[i].weight * max(0.0, 1.0 - out * out) ** 2
        _normal_equations(points, r, j, w / (scale * scale), state, h, g, of_camera)
        delta = np.linalg.solve(h, g)
        state -= delta
        if step > 2 and np.abs(delta[:3]).max() < least_step and np.abs(delta[3:6]).max() < 100.0 * least_step:
            break
    offsets = _camera_offsets(points, r, directions, w, cameras)
    error, total = 0.0, 1e-12
    for i in range(len(points)):
        c = points[i].camera
        rest = r[i] - offsets[c, 0] * directions[i, 0] - offsets[c, 1] * directions[i, 1]
        error += w[i] * rest * rest
        total += w[i]
    return Fit(np.linalg.inv(h) * (error / total / scale**2), math.sqrt(error / total), aside + offsets)


@njit(cache=True, nogil=True, error_model="numpy")
def _normal_equations(points: np.ndarray, r: Array, j: Array, weights: Array, state: Array, h: Array, g: Array, of_camera: Array) -> None:
    """Fill the normal matrix h and the gradient g with the points and with the prior of the edge shifts.

    Args:
        points: (n,) OUTLINE_POINT.
        r: (n,) pixels, residuals.
        j: (n, 6), their derivatives by position and velocity.
        weights: (n,) 1/pixels^2.
        state: (6 + cameras,).
        h: (6 + cameras, 6 + cameras).
        g: (6 + cameras,).
        of_camera: (cameras, 7, 7), work space: the normal matrix of each camera by position, velocity and its own edge shift.
    """
    row = np.empty(7)
    row[6] = -1.0
    h[:], g[:], of_camera[:] = 0.0, 0.0, 0.0
    for c in range(6, len(state)):
        h[c, c], g[c] = 1.0 / EDGE_PRIOR**2, state[c] / EDGE_PRIOR**2
    for i in range(len(points)):
        if weights[i] == 0.0:
            continue
        row[:6] = j[i]
        c = points[i].camera
        for a in range(7):
            pull = weights[i] * row[a]
            g[a if a < 6 else 6 + c] += pull * r[i]
            for b in range(a + 1):
                of_camera[c, a, b] += pull * row[b]
    for c in range(len(of_camera)):
        for a in range(7):
            for b in range(a + 1):
                p, q = a if a < 6 else 6 + c, b if b < 6 else 6 + c
                h[p, q] += of_camera[c, a, b]
                h[q, p] = h[p, q]


@njit(cache=True, nogil=True, error_model="numpy")
def _camera_offsets(points: np.ndarray, r: Array, directions: Array, w: Array, cameras: int) -> Array:
    """Return the shift (cameras, 2) pixels of each camera's points that explains their residuals best."""
    xx, xy, yy = np.zeros(cameras), np.zeros(cameras), np.zeros(cameras)
    bx, by = np.zeros(cameras), np.zeros(cameras)
    for i in range(len(points)):
        c = points[i].camera
        x, y = directions[i, 0], directions[i, 1]
        xx[c] += w[i] * x * x
        xy[c] += w[i] * x * y
        yy[c] += w[i] * y * y
        bx[c] += w[i] * x * r[i]
        by[c] += w[i] * y * r[i]
    offsets = np.zeros((cameras, 2))
    for c in range(cameras):
        det = xx[c] * yy[c] - xy[c] ** 2 + 1e-9
        offsets[c, 0] = (yy[c] * bx[c] - xy[c] * by[c]) / det
        offsets[c, 1] = (xx[c] * by[c] - xy[c] * bx[c]) / det
    return offsets
