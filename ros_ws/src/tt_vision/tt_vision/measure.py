"""A burst of images in, the ball's state out: position, velocity and spin at the last frame, or the reason why not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from tt_core.constants import BALL_RADIUS
from tt_core.errors import BadShape
from tt_core.failures import Failure
from tt_core.flight import Aerodynamics
from tt_core.states import Array, BallState

from .camera import Camera
from .detection.ball_detection import DetectionReason, Image, Spot, find_ball
from .detection.illumination import Lamps
from .motion_fit import Motion, MotionReason, doubt, fit_motion
from .spin.estimate import SpinEstimate, check_frames, check_times, spin_and_motion
from .spin.registration import DEFAULT, SearchParams, prepare

LEAST_FRAMES = 3  # with two, 8 % of the spins are wrong
MOST_FRAMES = 10  # more add time and no accuracy
AIR = Aerodynamics.measured()


class MeasurementReason(Enum):
    """Why a burst is not measured, beside MotionReason and SpinReason: codes of `tt_core.failures.Failure`."""

    BAD_CALIBRATION = "a camera's calibration is not finite"
    FEW_FRAMES = "{good} good frames of {frames}, {needed} needed; left out: {left_out}"
    SWAPPED = "the cameras are swapped"


@dataclass(frozen=True, eq=False)
class Measurement:
    """ball: at the time of the last frame used, with covariance; None when reason is not None.

    reason: why there is no ball. used: how many frames (pairs of images); left_out: how many did not show the whole ball, by reason.
    motion, spin: the parts, as far as they came.
    """

    ball: BallState | None
    reason: Failure | None
    used: int
    left_out: dict[DetectionReason, int]
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
        return Measurement(None, Failure(MeasurementReason.BAD_CALIBRATION), 0, {})
    times = check_times(times)
    sides = [left] if right is None else [left, right]
    check_frames([list(images) for images in sides], len(times), len(cameras))
    for camera, images in zip(cameras, sides, strict=True):
        if np.shape(images)[1:] != (camera.height, camera.width):
            raise BadShape("images", np.shape(images), f"(k, {camera.height}, {camera.width})")
    spots = spots if spots is not None else [[find_ball(image) for image in images] for images in sides]
    reasons = [next((spot.reason for spot in pair if spot.reason), None) for pair in zip(*spots, strict=True)]
    left_out = dict(Counter(reason.code for reason in reasons if reason))
    good = [k for k, reason in enumerate(reasons) if reason is None][-MOST_FRAMES:]
    if len(good) < LEAST_FRAMES:
        told = ", ".join(f"{count} x {code.value}" for code, count in left_out.items()) or "none"
        few = Failure(MeasurementReason.FEW_FRAMES, good=len(good), frames=len(times), needed=LEAST_FRAMES, left_out=told)
        return Measurement(None, few, len(good), left_out)
    frames = [[images[k] for k in good] for images in sides]
    spots = [[row[k] for k in good] for row in spots]
    times = times[good]
    motion, spin, reason = _fit(frames, spots, times, cameras, lamps, search)
    if motion is None or spin is None or reason:
        if len(cameras) > 1 and _fit(frames, spots, times, cameras[::-1], lamps, replace(search, second_look=False))[2] is None:
            reason = Failure(MeasurementReason.SWAPPED)
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
) -> tuple[Motion | None, SpinEstimate | None, Failure | None]:
    """Motion and spin, as far as they came, and the reason why they are not to be believed."""
    motion = fit_motion(frames, spots, times, cameras)
    if isinstance(motion, Failure):
        return None, None, motion
    reason = doubt(motion)
    if reason:
        return motion, None, reason
    spin, motion = spin_and_motion(frames, times, cameras, motion, spots, lamps, search)
    if spin.reason is not None and isinstance(spin.reason.code, MotionReason):
        return motion, None, spin.reason
    return motion, spin, spin.reason or doubt(motion)


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
