"""From a burst of images to the ball's state: position, velocity and spin at the last frame, or the reason why not.

The stages are a line, each a function from one object to the next, and all are called here:

    Burst -> detect_balls, whole_balls -> FirstLook -> cut_surface -> relight -> register_again, limb_outlines, refit_motion
    -> refine_distance (of a single camera) -> estimate_from

`FirstLook` gives the first estimate, at half the resolution; the stages after it work at the full one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from tt_core.errors import BadChoice, BadShape
from tt_core.failures import Failure
from tt_core.flight import Aerodynamics
from tt_core.states import Array, BallState

from .camera import Camera
from .capture.burst import LEAST_FRAMES, MOST_FRAMES, Burst, Image
from .detection.ball_detection import DetectionReason, detect_balls, first_reason, whole_balls
from .detection.illumination import CalibratedLamps
from .first_look import FirstEstimate, look_at
from .motion_fit import BallMotion, MotionReason, motion_doubt, refit_motion
from .spin.dissertation import method_1, method_2
from .spin.distance_refinement import refine_distance
from .spin.estimate import SpinEstimate, SpinReason, estimate_from
from .spin.limb_refinement import limb_outlines
from .spin.registration import (
    DEFAULT,
    ROUGH_STEP,
    Registration,
    SearchParams,
    register_again,
    register_marks,
    register_residual,
    with_near_rivals,
)
from .spin.relighting import relight
from .spin.soft_surface import softened
from .spin.surface_map import SurfaceMap, cut_surface

AIR = Aerodynamics.measured()
HOPELESS = 0.2  # residual beyond which refined outlines do not help; a ball half in the dark, 1.6 mm out of place, has 0.12
DISSERTATION = {"liu": method_2, "correlation": method_1}
METHODS = ("registration", *DISSERTATION)


class MeasurementReason(Enum):
    """Why a burst is not measured, beside MotionReason and SpinReason: codes of `tt_core.failures.Failure`."""

    BAD_CALIBRATION = "a camera's calibration is not finite"
    FEW_FRAMES = "{good} good frames of {frames}, {needed} needed; left out: {left_out}"
    SWAPPED = "the cameras are swapped"


class LeftOut(dict[DetectionReason, int]):
    """How many frames do not show the whole ball, by reason."""

    def __str__(self) -> str:
        """Return the counts as words."""
        return ", ".join(f"{count} x {code.value}" for code, count in self.items()) or "none"


@dataclass(frozen=True, eq=False)
class Measurement:
    """What a burst tells.

    Attributes:
        ball: The ball at the time of the last frame used, with covariance; None if there is a reason.
        reason: Why there is no ball, or None: a code of MeasurementReason, MotionReason or SpinReason.
        used: Number of frames (pairs of images) used.
        left_out: How many frames do not show the whole ball, by reason.
        motion: Position and velocity, if it came so far.
        spin: The spin, if it came so far.
    """

    ball: BallState | None
    reason: Failure | None
    used: int
    left_out: dict[DetectionReason, int]
    motion: BallMotion | None = None
    spin: SpinEstimate | None = None

    @property
    def residual(self) -> float:
        """Of the marks: 0 when they agree in all images, 1 when they are unrelated or not compared."""
        return 1.0 if self.spin is None else self.spin.residual


@dataclass(frozen=True, eq=False)
class _Estimate:
    """Motion and spin of a burst, as far as they came, and the reason why they are not to be believed."""

    motion: BallMotion | None
    spin: SpinEstimate | None
    reason: Failure | None


def measure(
    left: np.ndarray,
    right: np.ndarray | None,
    times: Array,
    cameras: Sequence[Camera],
    *,
    air: Aerodynamics = AIR,
    lamps: CalibratedLamps | None = None,
    search: SearchParams = DEFAULT,
) -> Measurement:
    """Measure the ball from the images of two cameras, or of one.

    With one camera the distance rests on the ball's size, which the covariance tells.

    Args:
        left: (k, h, w) uint8 or uint16.
        right: The same of the right camera; None for one camera, which `left` is of.
        times: (k,) s, rising, the middle of the exposures.
        cameras: (left, right), or the only one.
        air: See `measure_burst`.
        lamps: See `measure_burst`.
        search: See `measure_burst`.

    Raises:
        TtError: The arrays do not fit together.
    """
    if not _is_finite(cameras):
        return Measurement(None, Failure(MeasurementReason.BAD_CALIBRATION), 0, {})
    images = (left,) if right is None else (left, right)
    return measure_burst(Burst(images, times, tuple(cameras)), air=air, lamps=lamps, search=search)


def first_measurement(burst: Burst, first: FirstEstimate, air: Aerodynamics = AIR) -> Measurement:
    """Return what the first estimate of a burst tells by itself.

    Args:
        burst: With cameras; every image shows the whole ball.
        first: Its first estimate.
        air: See `measure_burst`.
    """
    motion, found = first.motion, first.found
    reason = first.reason if motion is None else motion_doubt(motion) or first.reason
    spin = None
    if motion is not None and found is not None:
        calibrated = first.light is not None and first.light.is_calibrated
        cameras = len(burst.cameras)
        spin = estimate_from(found, cameras=cameras, is_refined=False, is_light_calibrated=calibrated)
        reason = reason or spin.reason
    if motion is None or spin is None or reason:
        return Measurement(None, reason, len(burst), {}, motion, spin)
    return _measured(burst, motion, spin, air, {})


def measure_burst(
    burst: Burst,
    *,
    air: Aerodynamics = AIR,
    lamps: CalibratedLamps | None = None,
    search: SearchParams = DEFAULT,
    first: FirstEstimate | None = None,
) -> Measurement:
    """Measure the ball from a burst. Frames that do not show the whole ball in all images are left out.

    Args:
        burst: A burst with cameras. Where it holds no detections the ball is looked for.
        air: Bends the flight between the frames, which changes the velocity at the last one by 0.03 m/s.
        lamps: Calibrated lamps; None: the light is fitted to the burst.
        search: How much is spent on the spin.
        first: The first estimate of a burst of which every image shows the whole ball; None: it is made here.

    Raises:
        BadShape: The burst has no cameras.
        TtError: An image has a wrong type.
    """
    _check_cameras(burst)
    if not _is_finite(burst.cameras):
        return Measurement(None, Failure(MeasurementReason.BAD_CALIBRATION), 0, {})
    whole, left_out = whole_balls(detect_balls(burst), MOST_FRAMES)
    if len(whole) < LEAST_FRAMES:
        counts = {"good": len(whole), "frames": len(burst), "needed": LEAST_FRAMES}
        return Measurement(None, Failure(MeasurementReason.FEW_FRAMES, left_out=LeftOut(left_out), **counts), len(whole), left_out)
    found = _estimate(whole, lamps, search, first if len(whole) == len(burst) else None)
    if found.motion is None or found.spin is None or found.reason:
        reason = Failure(MeasurementReason.SWAPPED) if _is_swapped(whole, lamps, search) else found.reason
        return Measurement(None, reason, len(whole), left_out, found.motion, found.spin)
    return _measured(whole, found.motion, found.spin, air, left_out)


def _measured(burst: Burst, motion: BallMotion, spin: SpinEstimate, air: Aerodynamics, left_out: dict[DetectionReason, int]) -> Measurement:
    """Return the measurement of a burst with motion and spin, the flight bent by the air."""
    motion = motion.with_acceleration(air.acceleration(motion.velocity, spin.spin), burst.times)
    covariance = np.zeros((9, 9))
    covariance[:6, :6], covariance[6:, 6:] = motion.covariance, spin.covariance
    ball = BallState(motion.time, motion.position, motion.velocity, spin.spin, covariance)
    return Measurement(ball, None, len(burst), left_out, motion, spin)


def estimate_spin(
    frames: Sequence[Sequence[Image]],
    times: Array,
    cameras: Sequence[Camera],
    *,
    method: str = "registration",
    lamps: CalibratedLamps | None = None,
    search: SearchParams = DEFAULT,
) -> SpinEstimate:
    """Estimate the spin from images that all show the whole ball.

    Args:
        frames: [camera][frame] of (h, w) uint8 or uint16.
        times: (frames,) s, rising, the middle of the exposures.
        cameras: Who took them.
        method: "registration": every rotation up to 80 deg between frames is tried, and every spin up to `search.max_spin`.
            "liu": Method 2 of the dissertation. "correlation": its Method 1.
        lamps: Calibrated lamps; None: the light is fitted to the burst.
        search: How much is spent on the registration.

    Raises:
        BadChoice: There is no such method.
        TtError: The arrays do not fit together.
    """
    burst = Burst(tuple(_stack(row) for row in frames), times, tuple(cameras))
    _check_cameras(burst)
    if len(burst) < 2:
        return SpinEstimate.refused(Failure(SpinReason.FEW_FRAMES, frames=len(burst)))
    burst = detect_balls(burst)
    if reason := first_reason(burst):
        return SpinEstimate.refused(reason)
    if method in DISSERTATION:
        return SpinEstimate.without_covariance(*DISSERTATION[method](burst))
    if method != "registration":
        raise BadChoice("method", method, METHODS)
    found = _spin(burst, look_at(burst, search, lamps).estimate(burst), search)
    return found.spin or SpinEstimate.refused(found.reason)  # type: ignore[arg-type]


def _estimate(burst: Burst, lamps: CalibratedLamps | None, search: SearchParams, first: FirstEstimate | None = None) -> _Estimate:
    """Fit motion and spin to a burst with detections, of which every image shows the whole ball."""
    first = first or look_at(burst, search, lamps).estimate(burst)
    if first.motion is not None and (doubt := motion_doubt(first.motion)):
        return _Estimate(first.motion, None, doubt)
    found = _spin(burst, first, search)
    if found.reason or found.motion is None:
        return found
    return replace(found, reason=motion_doubt(found.motion))


def _spin(burst: Burst, first: FirstEstimate, search: SearchParams) -> _Estimate:
    """Refine a first estimate; the motion is known better with it, because outlines are found again with the marks known."""
    motion, found, light, soft = first.motion, first.found, first.light, first.surface
    if motion is None or found is None or light is None or soft is None:
        reason: Failure = first.reason  # type: ignore[assignment]
        return _Estimate(motion, None if motion is None else SpinEstimate.refused(reason), reason)
    surface, cameras, is_refined = cut_surface(burst, motion, light), len(burst.cameras), False
    shown = 4.0 * soft.weights.reshape(cameras, -1).sum(axis=1, dtype=np.float64)  # pixels of the full resolution
    if search.second_look and not found.agrees and found.residual < HOPELESS:
        refined = _refine(burst, motion, surface, register_marks(soft, found, search), shown, search)
        if not isinstance(refined, Failure):
            motion, surface, found = refined
            found = register_residual(softened(surface), found, search)
    elif search.second_look and found.is_believed:
        found = register_marks(soft, found, search)
    if not found.is_believed:
        spin = SpinEstimate.not_believed(found)
        return _Estimate(motion, spin, spin.reason)
    if search.second_look:
        refined = _refine(burst, motion, surface, found, shown, search)
        if isinstance(refined, Failure):
            return _Estimate(motion, None, refined)
        motion, surface, found = refined
        is_refined = motion is not first.motion
        if cameras == 1:
            motion, surface, found = refine_distance(burst, motion, surface, found, search)
    else:
        surface = surface.lit_by(light)
        found = register_again(surface, found, search)
    found = with_near_rivals(surface, found)
    spin = estimate_from(found, cameras=cameras, is_refined=is_refined, is_light_calibrated=light.is_calibrated)
    return _Estimate(motion, spin, spin.reason)


def _refine(
    burst: Burst, motion: BallMotion, surface: SurfaceMap, found: Registration, shown: Array, search: SearchParams
) -> tuple[BallMotion, SurfaceMap, Registration] | Failure:
    """Fit light, outlines, motion and spin again with the marks of a registration. shown: See `relight`.

    Where the outlines are too blurred to be found again, the motion stays as it is.
    """
    relit = relight(surface, found, shown)
    found = register_again(relit, found, search, ROUGH_STEP)
    points = limb_outlines(burst, relit, found)
    refitted = refit_motion(motion, points, burst, relit.illumination.is_calibrated)
    if isinstance(refitted, Failure):
        return (motion, relit, found) if refitted.code is MotionReason.FEW_POINTS else refitted
    moved = relit.moved_to(refitted, burst)
    return refitted, moved, register_again(moved, found, search)


def _is_swapped(burst: Burst, lamps: CalibratedLamps | None, search: SearchParams) -> bool:
    """Tell whether the images fit together if the two cameras are taken for each other."""
    if len(burst.cameras) < 2:
        return False
    if any(stack.shape[1:] != (camera.height, camera.width) for stack, camera in zip(burst.images, burst.cameras[::-1], strict=True)):
        return False
    return _estimate(burst.seen_by(burst.cameras[::-1]), lamps, replace(search, second_look=False)).reason is None


def _is_finite(cameras: Sequence[Camera]) -> bool:
    return all(np.isfinite(camera.vector).all() for camera in cameras)


def _check_cameras(burst: Burst) -> None:
    if not burst.cameras:
        raise BadShape("cameras", (0,), (len(burst.images),))


def _stack(row: Sequence[Image]) -> np.ndarray:
    """Return images as one array; raises BadShape for images of different sizes."""
    shapes = {np.shape(image) for image in row}
    if len(shapes) > 1:
        raise BadShape("images", shapes.pop(), shapes)
    return np.asarray(row)
