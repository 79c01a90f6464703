"""Position and velocity of the ball from its outlines in all images of a burst at once.

A burst holds the images of one ball's passage through the high speed cameras (about six pairs). This method replaces Section 2.2 of the
Nagoya dissertation. The rays from a camera to the points of the outline touch a sphere of known radius, so perspective is taken into
account exactly. The unknowns are the position and the velocity of the ball, and for each camera an edge shift: the distance in pixels by
which this camera's images show the edge of the ball too far out.
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
from .detection.outline import BLUR, blur_scale, edge_blur, scan_outline
from .projection import CameraModel, ray, rotate_back, to_camera, unpack_camera

EDGE_PRIOR = 0.6  # pixels, standard deviation of the edge shift of a camera before any measurement
LEAST_OUTLINE_POINTS = 16  # least average number of outline points in an image: a quarter of the outline
LIGHT_ERROR = (
    12e-6,
    45e-6,
)  # m, standard deviation across and along the lines of sight of the error in all frames alike by light that is brighter on one side
CALIBRATED_LIGHT_FACTOR = 0.5  # factor on LIGHT_ERROR if the lamps are calibrated
REFIT_TRUST = 0.5  # weight of the refitted position, because the light at the outline is only extrapolated from that further inside
VAGUE_OUTLINE = 0.4  # pixels rms; first outlines with a larger residual do not count in the refitted position; 0.1 to 0.3 are usual
AIR_ERROR = 0.1  # relative standard deviation of the acceleration by the air
OFFSET_ERROR = 0.1  # pixels; half of an offset of this length is attributed to the calibration, half to errors of the outlines
LITTLE_ASIDE = 0.02  # pixels; a smaller alignment moves the ball by less than the noise
MOST_OFFSET = 5.0  # pixels, largest offset of a camera with which a fit is accepted; 0.3 is usual where the light is bad
LEAST_MOTION_STEP = 1e-6  # m, and 100 times that in m/s: a fit ends after a shorter step, which shifts no pixel noticeably
FIRST_LEAST_STEP = 1e-4  # the same for the first fit; it is 0.07 pixels
FIRST_REACH = 0.35  # of the radius: distance from the rough outline within which the first fit scans for the outline
FINE_REACH = 4.0  # pixels, distance from the expected outline within which later fits scan for it, in a sharp image
MOST_RESIDUAL = 1.2  # pixels rms of the outline: 0.15 is usual, 0.8 with cameras 1 mm and 0.05 deg out of place, 1.6 with cameras swapped
MOST_APART = 3.0  # pixels, largest offset in u or v of a camera with which a motion is believed
MOST_EDGE = 2.0  # pixels, largest edge shift of a camera: 1.4 with 3 pixels of blur, 2.4 with the camera 10 cm out of place
FALL = (0.0, 0.0, -GRAVITY)  # m/s^2, in `table`
MOST_FIT_STEPS = 12  # largest number of steps of a fit
TUKEY = 4.7  # standard deviations beyond which a point has no weight


class MotionReason(Enum):
    """Reasons why no motion of a ball is found in the outlines, or why it is not believed; codes of `tt_core.failures.Failure`."""

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
    """Motion of the ball during a burst (the images of one ball's passage), in the frame `table`.

    Attributes:
        time: s, time of the last frame.
        position: (3,) m, at `time`.
        velocity: (3,) m/s, at `time`.
        covariance: (6, 6) of position and velocity.
        acceleration: (3,) m/s^2, taken as constant.
        residual: Root mean square distance of the outline points from the fitted outline, pixels, after subtracting `offsets`.
        offsets: (cameras, 2) pixels, mean offset (u, v) in each camera's images from the fitted ball to the ball as seen. It is caused
            mainly by errors of the cameras' calibration.
        edges: (cameras,) pixels, edge shift: by how much each camera's images show the edge of the ball too far out.
        points: Number of outline points.
        blurs: (cameras,) pixels, sigma of lens and motion at the outline in each camera's images, from `edge_blur`.
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
    blurs: Array

    @property
    def blur(self) -> float:
        """The largest of `blurs`, pixels."""
        return float(self.blurs.max())

    @property
    def sharp_residual(self) -> float:
        """The residual as it would be in sharp images, pixels: blurred outlines are less accurate by the factor `blur_scale`."""
        return self.residual / blur_scale(self.blur)

    @property
    def alignment(self) -> Array:
        """The part of `offsets` that is attributed to errors of the cameras' calibration, (cameras, 2) pixels."""
        return calibration_part(self.offsets)

    def positions(self, times: Array) -> Array:
        """Return the positions (n, 3) m of the ball in `table` at times (n,) s."""
        t = np.asarray(times)[:, None] - self.time
        return self.position + t * self.velocity + 0.5 * t * t * self.acceleration

    def at_distance(self, place: Array, factor: float) -> BallMotion:
        """Return the motion at another distance that looks the same from one place: it is scaled about this place.

        Args:
            place: (3,) m in `table`, such as the position of a camera.
            factor: New distance from `place` divided by the present one.
        """
        return replace(self, position=place + factor * (self.position - place), velocity=factor * self.velocity)

    def with_acceleration(self, acceleration: Array, times: Array) -> BallMotion:
        """Return the motion with another acceleration that agrees with the same images.

        The change of the flight by the acceleration is a parabola in time. The straight line that fits this parabola best at the times of
        the images is subtracted from position and velocity.

        Args:
            acceleration: (3,) m/s^2 in `table`.
            times: (k,) s, times of the images.
        """
        tau = np.asarray(times) - self.time
        line = np.linalg.lstsq(np.stack([np.ones_like(tau), tau], axis=1), 0.5 * tau * tau, rcond=None)[0]
        shift, rate = line
        more = np.asarray(acceleration) - self.acceleration
        sigma = AIR_ERROR * np.outer(line, more).ravel()
        return replace(
            self,
            position=self.position - shift * more,
            velocity=self.velocity - rate * more,
            acceleration=self.acceleration + more,
            covariance=self.covariance + np.outer(sigma, sigma),
        )


class FitSetup(NamedTuple):
    """Known quantities of a fit.

    Attributes:
        vectors: (cameras, 20) `Camera.vector` of each camera.
        tau: (frames,) s, times of the frames relative to their mean.
        acceleration: (3,) m/s^2 in `table`, constant acceleration of the ball.
    """

    vectors: Array
    tau: Array
    acceleration: Array


class FitState(NamedTuple):
    """The first six unknowns of a fit: position (m) and velocity (m/s) of the ball in `table` at tau = 0, the mean time of the frames.

    The further unknowns are the edge shifts of the cameras.
    """

    x: float
    y: float
    z: float
    vx: float
    vy: float
    vz: float


class Distances(NamedTuple):
    """Comparison of outline points with the outline that is computed from a state of the ball.

    Attributes:
        outwards: (n,) pixels, distance of each point from the computed outline, positive outwards.
        jacobian: (n, 6) derivatives of this distance by position (pixels/m) and velocity (pixels s/m). The derivative by the edge shift of
            the point's own camera is -1.
        directions: (n, 2) unit vector (u, v) in the image that points outwards.
    """

    outwards: Array
    jacobian: Array
    directions: Array


class Fit(NamedTuple):
    """Results of a fit besides the state, which is changed in place.

    Attributes:
        covariance: (6 + cameras, 6 + cameras) of position, velocity and edge shifts.
        residual: Root mean square distance of the outline points from the fitted outline, pixels, see `BallMotion.residual`.
        offsets: (cameras, 2) pixels, see `BallMotion.offsets`.
    """

    covariance: np.ndarray
    residual: float
    offsets: Array


def calibration_part(offsets: Array) -> Array:
    """Return the part of the cameras' offsets that is attributed to errors of their calibration, (cameras, 2) pixels.

    Errors of the outlines alone cause offsets of 0.05 pixels, a wrong calibration causes 0.3. So small offsets are reduced nearly to zero,
    and large ones are kept.

    Args:
        offsets: (cameras, 2) pixels, see `BallMotion.offsets`.
    """
    square = (offsets**2).sum(axis=1, keepdims=True)
    return np.asarray(offsets * square / (square + OFFSET_ERROR**2))


def fit_motion(burst: Burst, acceleration: Array = FALL) -> BallMotion | Failure:  # type: ignore[assignment]
    """Find the outlines of the ball in all images of a burst, and fit its motion to them.

    This is a least-squares fit over all outline points, done twice, with one unknown edge shift for each camera. Outliers, such as dots on
    the ball at its outline, are left out. An offset of a camera that is the same in all frames is subtracted in the second fit, because it
    is an error of the calibration, not a motion.

    Args:
        burst: A burst (the images of one ball's passage) with cameras and detections, in which every image shows the whole ball.
        acceleration: (3,) m/s^2 in `table`, constant acceleration of the ball.

    Returns:
        The motion, or the reason why none was found.
    """
    setup = _setup(burst, np.array(acceleration, dtype=np.float64))
    state, offsets = np.zeros(6 + len(burst.cameras)), np.zeros((len(burst.cameras), 2))
    circles = np.array([[(ball.u, ball.v, ball.radius) for ball in row] for row in burst.detections])
    try:
        state[:6] = _start(burst, setup, circles)
    except CannotTriangulate as error:
        return Failure(MotionReason.NO_START, error=error)
    points = _first_outlines(burst, setup, state)
    blurs = _outline_blurs(burst, points)
    motion = _solve(points, burst, setup, state, offsets, blurs, least_step=FIRST_LEAST_STEP)
    if isinstance(motion, Failure):
        return motion
    return _solve(_fine_outlines(burst, setup, state, blurs), burst, setup, state, motion.offsets, blurs)


def fit_motion_to_outlines(burst: Burst, points: np.ndarray, circles: Array, blurs: Array) -> BallMotion | Failure:
    """Fit the motion of the ball to outline points that have been found before, image by image.

    Args:
        burst: A burst (the images of one ball's passage) with cameras and detections, in which every image shows the whole ball.
        points: (n,) OUTLINE_POINT of all images; those of one image must follow each other.
        circles: (cameras, frames, 3) pixels: column u and row v of the ball's centre, and its radius in each image.
        blurs: (cameras,) pixels, see `BallMotion.blurs`.

    Returns:
        The motion, or the reason why none was found.
    """
    setup = _setup(burst, np.array(FALL))
    state, offsets = np.zeros(6 + len(burst.cameras)), np.zeros((len(burst.cameras), 2))
    try:
        state[:6] = _start(burst, setup, circles)
    except CannotTriangulate as error:
        return Failure(MotionReason.NO_START, error=error)
    motion = _solve(points, burst, setup, state, offsets, blurs)
    if isinstance(motion, Failure) or np.abs(motion.alignment).max() < LITTLE_ASIDE:
        return motion
    return _solve(points, burst, setup, state, motion.offsets, blurs)


def refit_motion(motion: BallMotion, points: np.ndarray, burst: Burst, is_light_calibrated: bool) -> BallMotion | Failure:
    """Fit the motion of the ball again, to outline points that were found again more accurately in the same burst.

    Args:
        motion: The motion so far.
        points: (n,) OUTLINE_POINT, the new points; those of one image must follow each other.
        burst: The burst.
        is_light_calibrated: Whether the points were found with the light of calibrated lamps. If not, the new position is the mean of the
            fitted one and that so far, unless the residual so far exceeds VAGUE_OUTLINE.

    Returns:
        The motion, or the reason why none was found.
    """
    setup = _setup(burst, motion.acceleration)
    middle = motion.positions(np.array([np.mean(burst.times)]))[0]
    state = np.concatenate([middle, motion.velocity - setup.tau[-1] * motion.acceleration, motion.edges])
    found = _solve(points, burst, setup, state, motion.offsets, motion.blurs, is_light_calibrated=is_light_calibrated)
    if isinstance(found, Failure) or is_light_calibrated or motion.sharp_residual > VAGUE_OUTLINE:
        return found
    return replace(found, position=found.position + (1.0 - REFIT_TRUST) * (middle - state[:3]))


def motion_doubt(motion: BallMotion) -> Failure | None:
    """Return the reason why a fitted motion is not believable; None if it is.

    A motion is not believable if it is not finite, or if its residual, an offset or an edge shift of a camera is too large.
    """
    if not (np.isfinite(motion.position).all() and np.isfinite(motion.velocity).all()):
        return Failure(MotionReason.NOT_FINITE)
    if motion.sharp_residual > MOST_RESIDUAL:
        return Failure(MotionReason.ROUGH_OUTLINE, residual=motion.sharp_residual, bound=MOST_RESIDUAL)
    apart, edge = float(np.abs(motion.offsets).max()), float(np.abs(motion.edges).max())
    if apart > MOST_APART:
        return Failure(MotionReason.APART, apart=apart, bound=MOST_APART)
    return Failure(MotionReason.WRONG_SIZE, edge=edge, bound=MOST_EDGE) if edge > MOST_EDGE else None


def _outline_blurs(burst: Burst, points: np.ndarray) -> Array:
    """Estimate the blur of each camera's images, (cameras,) pixels, from the outline in its first image.

    Args:
        burst: A burst (the images of one ball's passage) with cameras.
        points: (n,) OUTLINE_POINT of all images.
    """
    first = points[points["frame"] == 0]
    return np.array([edge_blur(images[0], first[first["camera"] == c]) for c, images in enumerate(burst.images)])


def _setup(burst: Burst, acceleration: Array) -> FitSetup:
    return FitSetup(np.array([camera.vector for camera in burst.cameras]), burst.from_middle, acceleration)


def _solve(
    points: np.ndarray,
    burst: Burst,
    setup: FitSetup,
    state: Array,
    offsets: Array,
    blurs: Array,
    *,
    is_light_calibrated: bool = False,
    least_step: float = LEAST_MOTION_STEP,
) -> BallMotion | Failure:
    """Fit the motion to outline points, starting from a state.

    Args:
        points: (n,) OUTLINE_POINT.
        burst: The burst.
        setup: Cameras, times and acceleration.
        state: (6 + cameras,) position, velocity and edge shifts at tau = 0, changed in place to the result.
        offsets: (cameras, 2) pixels, known offsets; the part that is attributed to the calibration is subtracted from the points.
        blurs: (cameras,) pixels, see `BallMotion.blurs`; the result keeps it.
        is_light_calibrated: Whether the points were found with the light of calibrated lamps.
        least_step: m, and 100 times that in m/s: the fit ends after a shorter step.

    Returns:
        The motion, or the reason why none was found.
    """
    tau, cameras = setup.tau, burst.cameras
    if len(points) < LEAST_OUTLINE_POINTS * len(tau) * len(cameras):
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
    across, along = np.array(LIGHT_ERROR) * (CALIBRATED_LIGHT_FACTOR if is_light_calibrated else 1.0)
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
        blurs=blurs,
    )
    aside = np.abs(motion.alignment).max() * np.linalg.norm(position - cameras[0].position) / cameras[0].focal_pixels
    covariance[:3, :3] += aside**2 * np.eye(3)  # if the cameras disagree, it is unknown which of them is wrong
    return motion


def _start(burst: Burst, setup: FitSetup, circles: Array) -> Array:
    """Estimate position (m) and velocity (m/s) at tau = 0, (6,), from the circles (cameras, frames, 3) of the ball in the images.

    The distance from a single camera is estimated from the size of the ball.
    """
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
    """Find the outline points (n,) OUTLINE_POINT in a wide ring around the detected ball in each image."""
    found = []
    for c, row in enumerate(burst.detections):
        for k, (ball, (_, _, radius)) in enumerate(zip(row, _circles(setup, state, c), strict=True)):
            reach = max(FIRST_REACH * radius, FINE_REACH)
            points = scan_outline(burst.images[c][k], ball.u, ball.v, radius - reach, radius + reach, ball.contrast, BLUR)
            points["camera"], points["frame"] = c, k
            found.append(points)
    return np.concatenate(found)


def _fine_outlines(burst: Burst, setup: FitSetup, state: Array, blurs: Array) -> np.ndarray:
    """Find the outline points (n,) OUTLINE_POINT in a narrow ring around the outline that a state gives in each image."""
    found = []
    for c, row in enumerate(burst.detections):
        reach = blur_scale(blurs[c]) * FINE_REACH
        for k, (ball, (u, v, radius)) in enumerate(zip(row, _circles(setup, state, c), strict=True)):
            points = scan_outline(burst.images[c][k], u, v, radius - reach, radius + reach, ball.contrast, blurs[c])
            points["camera"], points["frame"] = c, k
            found.append(points)
    return np.concatenate(found)


@njit(cache=True, nogil=True, error_model="numpy")
def _circles(setup: FitSetup, state: Array, c: int) -> list[tuple[float, float, float]]:
    """Compute where camera c sees the ball in each frame, without lens distortion.

    Args:
        setup: Cameras, times and acceleration.
        state: (6 + cameras,) at tau = 0.
        c: Index of the camera.

    Returns:
        For each frame column u and row v of the centre, and the radius, pixels.
    """
    camera, flight, out = unpack_camera(setup.vectors[c]), unpack_state(state), []
    for t in setup.tau:
        x, y, z = to_camera(camera, *ball_at(flight, setup.acceleration, t))
        scale = camera.optics.focal / z
        out.append((scale * x + camera.optics.u0, scale * y + camera.optics.v0, BALL_RADIUS * scale))
    return out


@njit(cache=True, nogil=True, forceinline=True)
def unpack_state(state: Array) -> FitState:
    """Return position and velocity of a state (6 + cameras,) with their names."""
    return FitState(state[0], state[1], state[2], state[3], state[4], state[5])


@njit(cache=True, nogil=True, forceinline=True, error_model="numpy")
def ball_at(s: FitState, acceleration: Array, t: float) -> tuple[float, float, float]:
    """Return the position (x, y, z) of the ball in `table`, m.

    Args:
        s: Position and velocity at tau = 0.
        acceleration: (3,) m/s^2, constant.
        t: s after tau = 0.
    """
    return (
        s.x + t * (s.vx + 0.5 * t * acceleration[0]),
        s.y + t * (s.vy + 0.5 * t * acceleration[1]),
        s.z + t * (s.vz + 0.5 * t * acceleration[2]),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def bearings(points: np.ndarray, vectors: Array) -> Array:
    """Return the unit vectors (n, 3) from the camera to outline points, each in the frame of the point's own camera.

    Args:
        points: (n,) OUTLINE_POINT.
        vectors: (cameras, 20) `Camera.vector` of each camera.
    """
    out = np.empty((len(points), 3))
    for i in range(len(points)):
        point = points[i]
        x, y = ray(unpack_camera(vectors[point.camera]).optics, point.u, point.v)
        scale = 1.0 / math.sqrt(x * x + y * y + 1.0)
        out[i, 0], out[i, 1], out[i, 2] = x * scale, y * scale, scale
    return out


class Silhouette(NamedTuple):
    """The ball as one camera sees it in one frame.

    Attributes:
        px: x component of the unit vector from the camera to the ball's centre, in the camera's frame.
        py: y component of this unit vector.
        pz: z component of this unit vector.
        distance: m, from the camera to the ball's centre.
        limb: rad, angle between the directions to the centre and to the outline of the ball.
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
    """Compare outline points with the outline that is computed from a state of the ball; the arguments are not validated.

    Args:
        points: (n,) OUTLINE_POINT; those of one image must follow each other.
        rays: (n, 3) unit vectors to these points, from `bearings`.
        setup: Cameras, times and acceleration.
        state: (6 + cameras,) position (m) and velocity (m/s) in `table` at tau = 0, and the edge shift of each camera (pixels).
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
    """Fit a state to outline points by Gauss-Newton with Tukey's weights.

    Args:
        points: (n,) OUTLINE_POINT.
        setup: Cameras, times and acceleration.
        state: (6 + cameras,) where the fit starts, see `distances`; changed in place.
        aside: (cameras, 2) pixels, known offset (u, v) of each camera, which is subtracted from its points.
        least_step: m, and 100 times that in m/s: the fit ends after a shorter step.
    """
    size, cameras = len(state), len(setup.vectors)
    scale = 3.0
    w, rays = np.zeros(len(points)), bearings(points, setup.vectors)
    r, directions = np.empty(0), np.empty((0, 2))
    h, g, of_camera = np.empty((size, size)), np.empty(size), np.empty((cameras, 7, 7))
    for step in range(MOST_FIT_STEPS):
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
    """Compute the normal equations of all points and of the prior on the edge shifts.

    Args:
        points: (n,) OUTLINE_POINT.
        r: (n,) pixels, residuals.
        j: (n, 6) derivatives of the residuals by position and velocity.
        weights: (n,) 1/pixels^2, weights of the points.
        state: (6 + cameras,), of which the edge shifts are used.
        h: (6 + cameras, 6 + cameras) filled with the normal matrix.
        g: (6 + cameras,) filled with the gradient.
        of_camera: (cameras, 7, 7) work space: the normal matrix of each camera for position, velocity and its own edge shift.
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
    """Return the offset (cameras, 2), pixels, of each camera's points that fits their residuals best (weighted least squares).

    Args:
        points: (n,) OUTLINE_POINT.
        r: (n,) pixels, residuals, positive outwards.
        directions: (n, 2) unit vectors outwards.
        w: (n,) weights.
        cameras: Number of cameras.
    """
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
