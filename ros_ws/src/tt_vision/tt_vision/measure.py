"""Measurement of the ball: from a burst to position, velocity and spin at its last frame, or to the reason why there is no result.

A burst holds the images of one ball's passage through the high speed cameras (about six pairs). "Marks" are the printed or drawn dots on
the ball. The measurement has these stages, each of them a function that takes the result of the one before; all are called in this module:

    Burst -> detect_balls, whole_balls -> FirstEstimator -> cut_surface -> relight -> register_again, limb_outlines, refit_motion
    -> refine_distance, register_again (of a single camera) -> estimate_from

`FirstEstimator` makes the first estimate from images at half the resolution. The stages after it work at the full resolution.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from tt_core.arrays import Array, Image
from tt_core.errors import BadChoice, BadShape
from tt_core.failures import Failure
from tt_core.flight import Aerodynamics
from tt_core.states import BallState

from .camera import Camera
from .capture.burst import LEAST_FRAMES, MOST_FRAMES, Burst
from .detection.ball_detection import DetectionReason, detect_balls, first_reason, whole_balls
from .detection.illumination import CalibratedLamps
from .first_estimate import FirstEstimate, estimator_of
from .motion_fit import BallMotion, MotionReason, motion_doubt, refit_motion
from .spin.dissertation import method_1, method_2
from .spin.distance_refinement import refine_distance
from .spin.estimate import SpinEstimate, SpinReason, estimate_from
from .spin.limb_refinement import limb_outlines
from .spin.registration import (
    DEFAULT_SEARCH,
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
UNREFINABLE_RESIDUAL = 0.2  # above which refined outlines do not help; a ball half in the dark whose position is 1.6 mm off has 0.12
DISSERTATION = {"liu": method_2, "correlation": method_1}
SPIN_METHODS = ("registration", *DISSERTATION)


class MeasurementReason(Enum):
    """Reasons why a burst gives no measurement, besides those of `MotionReason` and `SpinReason`; codes of `tt_core.failures.Failure`."""

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
    """Result of the measurement of a burst (the images of one ball's passage): the state of the ball, or why there is none.

    Attributes:
        ball: State of the ball in `table` at the time of the last frame that was used, with covariance; None if `reason` is set.
        reason: Why there is no result, with a code of `MeasurementReason`, `MotionReason` or `SpinReason`; None if there is one.
        used: Number of frames (pairs of images) that were used.
        left_out: Number of frames that do not show the whole ball, by reason.
        motion: Position and velocity; None if the measurement failed before they were known.
        spin: The spin, or why there is none; None if the measurement failed before the spin was estimated.
    """

    ball: BallState | None
    reason: Failure | None
    used: int
    left_out: dict[DetectionReason, int]
    motion: BallMotion | None = None
    spin: SpinEstimate | None = None

    @property
    def residual(self) -> float:
        """Disagreement of the ball's marks (dots) between the images: 0 if they agree everywhere, 1 if they are unrelated.

        It is also 1 if the marks were not compared.
        """
        return 1.0 if self.spin is None else self.spin.residual


@dataclass(frozen=True, eq=False)
class _Estimate:
    """Motion and spin of a burst, None if they were not reached, and the reason why the result is not believed, or None."""

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
    search: SearchParams = DEFAULT_SEARCH,
) -> Measurement:
    """Measure position, velocity and spin of the ball from the images of two cameras, or of one.

    With one camera the distance is estimated from the size of the ball, so it is less accurate, as the covariance shows.

    Args:
        left: (k, h, w) uint8 or uint16, images of the left or the only camera.
        right: (k, h, w) uint8 or uint16, images of the right camera; None if there is only one camera.
        times: (k,) s, rising, the middle of the exposure of each frame.
        cameras: The left and the right camera, or the only one.
        air: Model of the air, see `measure_burst`.
        lamps: Calibrated lamps, see `measure_burst`.
        search: Parameters of the search for the spin, see `measure_burst`.

    Raises:
        TtError: The arrays do not fit together.
    """
    if not _is_finite(cameras):
        return Measurement(None, Failure(MeasurementReason.BAD_CALIBRATION), 0, {})
    images = (left,) if right is None else (left, right)
    return measure_burst(Burst(images, times, tuple(cameras)), air=air, lamps=lamps, search=search)


def first_measurement(burst: Burst, first: FirstEstimate, air: Aerodynamics = AIR) -> Measurement:
    """Convert the first estimate of a burst, which is made at half the resolution, to a measurement without refining it.

    Args:
        burst: The burst (the images of one ball's passage) with cameras; every image shows the whole ball.
        first: The first estimate of this burst.
        air: Model of the air, see `measure_burst`.
    """
    motion, found = first.motion, first.found
    reason = first.reason if motion is None else motion_doubt(motion) or first.reason
    spin = None
    if motion is not None and found is not None:
        calibrated = first.light is not None and first.light.is_calibrated
        cameras = len(burst.cameras)
        spin = estimate_from(found, cameras=cameras, is_refined=False, is_light_calibrated=calibrated, blur=motion.blur)
        reason = reason or spin.reason
    if motion is None or spin is None or reason:
        return Measurement(None, reason, len(burst), {}, motion, spin)
    return _measured(burst, motion, spin, air, {})


def measure_burst(
    burst: Burst,
    *,
    air: Aerodynamics = AIR,
    lamps: CalibratedLamps | None = None,
    search: SearchParams = DEFAULT_SEARCH,
    first: FirstEstimate | None = None,
) -> Measurement:
    """Measure position, velocity and spin of the ball from a burst (the images of one ball's passage through the cameras).

    Frames that do not show the whole ball in all images are left out.

    Args:
        burst: The burst, with cameras. In images without a detection the ball is looked for.
        air: Model of the air, by whose drag and lift the flight is curved between the frames; this changes the velocity at the last frame
            by 0.03 m/s.
        lamps: Calibrated lamps; None if the light is to be fitted to the burst.
        search: Parameters of the search for the spin, which determine its accuracy and its computing time.
        first: The first estimate of this burst, used if every image shows the whole ball; None if it is to be made here.

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
    """Return the measurement from motion and spin, with the flight curved by the forces of the air."""
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
    search: SearchParams = DEFAULT_SEARCH,
) -> SpinEstimate:
    """Estimate the spin of the ball from images in which the whole ball is visible.

    Args:
        frames: Images indexed [camera][frame], each (h, w) uint8 or uint16.
        times: (frames,) s, rising, the middle of the exposure of each frame.
        cameras: The cameras that took the images.
        method: "registration" tries every rotation up to 80 deg between frames and, if `search.max_spin` is set, every spin up to that
            value; it finds the spin that makes the marks (dots on the ball) agree in all images. "liu" is Method 2 of the dissertation,
            "correlation" its Method 1.
        lamps: Calibrated lamps; None if the light is to be fitted to the images.
        search: Parameters of the registration, which determine its accuracy and its computing time.

    Returns:
        The spin, or the reason why there is none (`SpinEstimate.reason`).

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
        raise BadChoice("method", method, SPIN_METHODS)
    found = _spin(burst, estimator_of(burst, search, lamps).estimate(burst), search)
    return found.spin or SpinEstimate.refused(found.reason)  # type: ignore[arg-type]


def _estimate(burst: Burst, lamps: CalibratedLamps | None, search: SearchParams, first: FirstEstimate | None = None) -> _Estimate:
    """Estimate motion and spin from a burst with detections, in which every image shows the whole ball; `first`: its first estimate."""
    first = first or estimator_of(burst, search, lamps).estimate(burst)
    if first.motion is not None and (doubt := motion_doubt(first.motion)):
        return _Estimate(first.motion, None, doubt)
    found = _spin(burst, first, search)
    if found.reason or found.motion is None:
        return found
    return replace(found, reason=motion_doubt(found.motion))


def _spin(burst: Burst, first: FirstEstimate, search: SearchParams) -> _Estimate:
    """Refine the first estimate of motion and spin at the full resolution.

    The motion becomes more accurate, too, because the outlines are found again once the marks are known.
    """
    motion, found, light, soft = first.motion, first.found, first.light, first.surface
    if motion is None or found is None or light is None or soft is None:
        reason: Failure = first.reason  # type: ignore[assignment]
        return _Estimate(motion, None if motion is None else SpinEstimate.refused(reason), reason)
    surface, cameras, is_refined = cut_surface(burst, motion, light), len(burst.cameras), False
    shown = 4.0 * soft.weights.reshape(cameras, -1).sum(axis=1, dtype=np.float64)  # pixels of the full resolution
    if search.second_look and not found.agrees and found.residual < UNREFINABLE_RESIDUAL:
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
            motion = refine_distance(burst, motion, surface, found.spin, search)
            surface = surface.moved_to(motion, burst)
            found = register_again(surface, found, search)
    else:
        surface = surface.lit_by(light)
        found = register_again(surface, found, search)
    found = with_near_rivals(surface, found)
    spin = estimate_from(found, cameras=cameras, is_refined=is_refined, is_light_calibrated=light.is_calibrated, blur=motion.blur)
    return _Estimate(motion, spin, spin.reason)


def _refine(
    burst: Burst, motion: BallMotion, surface: SurfaceMap, found: Registration, shown: Array, search: SearchParams
) -> tuple[BallMotion, SurfaceMap, Registration] | Failure:
    """Fit light, outlines, motion and spin again, once the marks on the ball are known.

    If the outlines are too blurred to be found again, the motion stays as it is.

    Args:
        burst: The burst.
        motion: The motion so far.
        surface: The surface of the ball in all images.
        found: The spin so far, with the marks.
        shown: (cameras,), see `relight`.
        search: Parameters of the registration.

    Returns:
        Motion, surface and registration; or the reason why the motion cannot be fitted.
    """
    relit = relight(surface, found, shown)
    found = register_again(relit, found, search, ROUGH_STEP)
    points = limb_outlines(burst, relit, found, motion.blurs)
    refitted = refit_motion(motion, points, burst, relit.illumination.is_calibrated)
    if isinstance(refitted, Failure):
        return (motion, relit, found) if refitted.code is MotionReason.FEW_POINTS else refitted
    moved = relit.moved_to(refitted, burst)
    return refitted, moved, register_again(moved, found, search)


def _is_swapped(burst: Burst, lamps: CalibratedLamps | None, search: SearchParams) -> bool:
    """Return whether the images agree if each of the two cameras is taken for the other: the cameras are then swapped."""
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
    """Return images as one array (k, h, w); raise BadShape for images of different sizes."""
    shapes = {np.shape(image) for image in row}
    if len(shapes) > 1:
        raise BadShape("images", shapes.pop(), shapes)
    return np.asarray(row)
