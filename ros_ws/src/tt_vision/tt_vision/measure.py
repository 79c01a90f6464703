"""A burst of images in, the ball's state out: position, velocity and spin at the last frame, or the reason why not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from tt_core.constants import BALL_RADIUS
from tt_core.errors import BadShape, TtError
from tt_core.flight import Aerodynamics
from tt_core.states import Array, BallState

from .camera import Camera
from .detection.ball_detection import Image, Spot, find_ball
from .detection.illumination import Lamps
from .motion_fit import Motion, fit_motion
from .spin.estimate import SpinEstimate, check_frames, check_times, spin_and_motion
from .spin.registration import DEFAULT, SearchParams, prepare

LEAST_FRAMES = 3  # with two, 8 % of the spins are wrong
MOST_FRAMES = 10  # more add time and no accuracy
ROUGH = 1.2  # pixels rms of the outline: 0.15 is usual, 0.8 with cameras 1 mm and 0.05 deg out of place, 1.6 with cameras swapped
AIR = Aerodynamics.measured()
APART = 3.0  # pixels between what the cameras' calibration and the ball's size promise and what is seen


@dataclass(frozen=True, eq=False)
class Measurement:
    """ball: at the time of the last frame used, with covariance; None when reason is not None.

    reason: why there is no ball. used: how many frames (pairs of images); left_out: how many did not show the whole ball, by reason.
    motion, spin: the parts, as far as they came.
    """

    ball: BallState | None
    reason: str | None
    used: int
    left_out: dict[str, int]
    motion: Motion | None = None
    spin: SpinEstimate | None = None

    @property
    def residual(self) -> float:
        """Of the marks: 0 when they agree in all images, 1 when unrelated or not compared."""
        return 1.0 if self.spin is None else self.spin.residual


def measure(
    left: np.ndarray,
    right: np.ndarray | None,
    times: Array,
    cameras: Sequence[Camera],
    *,
    air: Aerodynamics = AIR,
    lamps: Lamps | None = None,
    search: SearchParams = DEFAULT,
    spots: Sequence[Sequence[Spot]] | None = None,
) -> Measurement:
    """left, right: (k, h, w) uint8 or uint16, taken at `times` (k,) s, rising, middle of the exposure. cameras: (left, right).
    One camera alone: `right` is None, `cameras` holds it, and the distance rests on the ball's size; the covariance says so.
    air: bends the flight between the frames, which turns the velocity at the last one by 0.03 m/s. lamps: when calibrated; otherwise light
    is fitted to the burst. search: how much is spent on the spin. spots: [camera][frame], when each frame was looked at as it came.

    Frames that do not show the whole ball in both images are left out. Raises TtError for arrays that do not fit together.
    """
    if not all(np.isfinite(camera.vector).all() for camera in cameras):
        return Measurement(None, "a camera's calibration is not finite", 0, {})
    times = check_times(times)
    sides = [left] if right is None else [left, right]
    check_frames([list(images) for images in sides], len(times), len(cameras))
    for camera, images in zip(cameras, sides, strict=True):
        if np.shape(images)[1:] != (camera.height, camera.width):
            raise BadShape("images", np.shape(images), f"(k, {camera.height}, {camera.width})")
    spots = spots if spots is not None else [[find_ball(image) for image in images] for images in sides]
    reasons = [next((spot.reason for spot in pair if spot.reason), None) for pair in zip(*spots, strict=True)]
    left_out = dict(Counter(reason for reason in reasons if reason))
    good = [k for k, reason in enumerate(reasons) if reason is None][-MOST_FRAMES:]
    if len(good) < LEAST_FRAMES:
        why = "".join(f", {count} x {reason}" for reason, count in left_out.items())
        return Measurement(None, f"{len(good)} good frames of {len(times)}, {LEAST_FRAMES} needed{why}", len(good), left_out)
    frames = [[images[k] for k in good] for images in sides]
    spots = [[row[k] for k in good] for row in spots]
    times = times[good]
    motion, spin, reason = _fit(frames, spots, times, cameras, lamps, search)
    if motion is None or spin is None or reason:
        if len(cameras) > 1 and _fit(frames, spots, times, cameras[::-1], lamps, replace(search, second_look=False))[2] is None:
            reason = "the cameras are swapped"
        return Measurement(None, reason, len(good), left_out, motion, spin)
    motion = motion.bent(air.acceleration(motion.velocity, spin.spin), times)
    covariance = np.zeros((9, 9))
    covariance[:6, :6], covariance[6:, 6:] = motion.covariance, spin.covariance
    ball = BallState(motion.time, motion.position, motion.velocity, spin.spin, covariance)
    return Measurement(ball, None, len(good), left_out, motion, spin)


def _fit(
    frames: Sequence[Sequence[Image]],
    spots: Sequence[Sequence[Spot]],
    times: Array,
    cameras: Sequence[Camera],
    lamps: Lamps | None,
    search: SearchParams,
) -> tuple[Motion | None, SpinEstimate | None, str | None]:
    """Motion and spin, as far as they came, and the reason why they are not to be believed."""
    try:
        motion = fit_motion(frames, spots, times, cameras)
    except TtError as error:
        return None, None, f"no ball: {error}"
    reason = _doubt(motion)
    if reason:
        return motion, None, reason
    try:
        spin, motion = spin_and_motion(frames, times, cameras, motion, spots, lamps, search)
    except TtError as error:
        return motion, None, f"no ball: {error}"
    return motion, spin, spin.reason or _doubt(motion)


def _doubt(motion: Motion) -> str | None:
    if not (np.isfinite(motion.position).all() and np.isfinite(motion.velocity).all()):
        return "no ball: the outlines do not fit"
    if motion.residual > ROUGH:
        return f"no ball: outline off by {motion.residual:.2f} pixels rms"
    if np.abs(motion.offsets).max() > APART:
        return f"the cameras do not see the same ball: {np.abs(motion.offsets).max():.1f} pixels apart"
    if np.abs(motion.edges).max() > APART:
        return f"no ball: its outline is {np.abs(motion.edges).max():.1f} pixels too large or too small"
    return None


def warm(cameras: Sequence[Camera]) -> None:
    """Compiles every kernel and fills every table that `measure` uses, on drawn images of 8 and of 16 bits."""
    axis = np.mean([camera.rotation[2] for camera in cameras], axis=0)
    start = np.mean([camera.position for camera in cameras], axis=0) + axis
    times = np.arange(LEAST_FRAMES) / 900.0
    frames = [[_draw(camera, start + t * np.array([0.0, 0.0, 2.0]), 100.0 * t) for t in times] for camera in cameras]
    for dtype in (np.uint8, np.uint16):
        left, right = (np.array(images, dtype=dtype) for images in frames)
        measure(left, right, times, cameras)  # refused: what is drawn is no ball that both cameras see
        measure(left, None, times, cameras[:1])
    measure(left, None, times, cameras[:1], lamps=Lamps(start[None] + 1.0, np.ones(1), 1.0))
    prepare()


def _draw(camera: Camera, centre: Array, angle: float) -> np.ndarray:
    """(h, w) a chequered ball, turned by `angle` rad about the vertical."""
    v, u = np.mgrid[: camera.height, : camera.width]
    at = camera.rotation @ centre + camera.translation
    x, y = u - camera.project(centre[None])[0, 0], v - camera.project(centre[None])[0, 1]
    radius = camera.focal_pixels * BALL_RADIUS / at[2]
    z = np.sqrt(np.maximum(0.0, radius**2 - x * x - y * y))
    dark = np.sin(5.0 * (np.arctan2(x, z) - angle)) * np.sin(6.0 * y / radius) > 0.4
    return np.where(z > 0.0, np.where(dark, 40, 200), 8)
