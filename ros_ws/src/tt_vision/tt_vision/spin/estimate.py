"""The spin of the ball from a burst of images (dissertation Sections 2.3 and 2.4, and a registration without initial guess)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from tt_core.errors import BadChoice, BadShape, TtError, check_array
from tt_core.failures import Failure
from tt_core.states import Array

from ..camera import Camera
from ..detection.ball_detection import Image, Spot, find_ball
from ..detection.illumination import Lamps
from ..motion_fit import Motion, fit_motion
from .dissertation import method_1, method_2
from .limb_refinement import look_again
from .registration import DEFAULT, GATE, SearchParams, judged, register
from .surface_map import DULL, unwrap

SYSTEMATIC = (0.17, 5.5e-4)  # rad/s, and of the spin: standard deviation of what noise does not explain, light and centres
CORRELATED = 1.5  # neighbouring points share pixels: the least squares counts each pixel that often
KNOWN, FIRST, ALONE = 0.75, 1.5, 3.0  # times SYSTEMATIC: with known lamps, without a second look, with one camera
HOPELESS = 0.2  # residual beyond which no look at the outline helps; a ball half in the dark, 1.6 mm out of place, has 0.12
UNKNOWN = 1e6  # (rad/s)^2
PRINTED = {"liu": method_2, "correlation": method_1}
METHODS = ("registration", *PRINTED)


class SpinReason(Enum):
    """Why there is no estimate of the spin: codes of `tt_core.failures.Failure`."""

    FEW_FRAMES = "{frames} frames cannot tell a spin"
    NO_MARKS = "no marks on the ball"
    NO_AGREEMENT = "marks do not agree between frames (residual {residual:.2f})"


@dataclass(frozen=True, eq=False)
class SpinEstimate:
    """spin: (3,) rad/s in `table`; covariance: (3, 3), large for the printed methods, which tell none. residual: 0 for marks that agree in
    all images, 1 for unrelated ones; of the printed methods E (2.32) and V (2.21).

    reason: None, or why there is no estimate: then spin is zero and the covariance large. iterations: rotations tried or steps taken.
    """

    spin: Array
    covariance: Array
    residual: float
    reason: Failure | None = None
    iterations: int = 0


def estimate_spin(
    frames: Sequence[Sequence[Image]],
    times: Array,
    cameras: Sequence[Camera],
    *,
    method: str = "registration",
    motion: Motion | None = None,
    spots: Sequence[Sequence[Spot]] | None = None,
    lamps: Lamps | None = None,
    search: SearchParams = DEFAULT,
) -> SpinEstimate:
    """Spin from images that all show the whole ball.

    frames: [camera][frame] of (h, w) uint8 or uint16. times: (frames,) s, rising, middle of the exposures. motion, spots: when already
    known. lamps: when calibrated; otherwise light is fitted to the burst. search: how much is spent.
    method: "registration", every rotation up to 66 deg between frames is tried; "liu", Method 2 of the dissertation; "correlation", its
    Method 1. Raises TtError for arguments that do not fit together.
    """
    times = check_times(times)
    check_frames(frames, len(times), len(cameras))
    if len(times) < 2:
        return refused(Failure(SpinReason.FEW_FRAMES, frames=len(times)))
    spots = spots if spots is not None else [[find_ball(image) for image in row] for row in frames]
    for row in spots:
        for spot in row:
            if spot.reason is not None:
                return refused(spot.reason)
    if method == "registration":
        fitted = motion or fit_motion(frames, spots, times, cameras)
        if isinstance(fitted, Failure):
            return refused(fitted)
        return spin_and_motion(frames, times, cameras, fitted, spots, lamps, search)[0]
    if method in PRINTED:
        spin, residual, iterations = PRINTED[method](frames, spots, times, cameras)
        return SpinEstimate(spin, UNKNOWN * np.eye(3), residual, None, iterations)
    raise BadChoice("method", method, METHODS)


def spin_and_motion(
    frames: Sequence[Sequence[Image]],
    times: Array,
    cameras: Sequence[Camera],
    motion: Motion,
    spots: Sequence[Sequence[Spot]],
    lamps: Lamps | None = None,
    search: SearchParams = DEFAULT,
) -> tuple[SpinEstimate, Motion]:
    """The spin by registration, and the motion, which is better known with it: arguments as those of `estimate_spin`, all checked."""
    backgrounds = np.array([[spot.background for spot in row] for row in spots])
    surface = unwrap(frames, backgrounds, motion.positions(times), motion.alignment, times - np.mean(times), cameras, lamps)
    if surface.contrast < DULL:
        return refused(Failure(SpinReason.NO_MARKS)), motion
    found = register(surface, search)
    if search.second_look and GATE < found.residual < HOPELESS:
        again = look_again(frames, spots, times, cameras, surface, found, motion, search)
        if isinstance(again, Failure):
            return refused(again), motion
        surface, found, motion = again
        found = judged(surface, found, search)
    if found.residual > GATE:
        return refused(Failure(SpinReason.NO_AGREEMENT, residual=found.residual), found.residual, found.candidates), motion
    if search.second_look:
        again = look_again(frames, spots, times, cameras, surface, found, motion, search)
        if isinstance(again, Failure):
            return refused(again), motion
        _, found, motion = again
    certain = (FIRST if not search.second_look else 1.0 if lamps is None else KNOWN) * (ALONE if len(cameras) == 1 else 1.0)
    systematic = certain * np.hypot(SYSTEMATIC[0], SYSTEMATIC[1] * np.linalg.norm(found.spin))
    covariance = CORRELATED * np.linalg.inv(found.information) + systematic**2 * np.eye(3)
    return SpinEstimate(found.spin, covariance, found.residual, None, found.candidates), motion


def refused(reason: Failure, residual: float = 1.0, iterations: int = 0) -> SpinEstimate:
    return SpinEstimate(np.zeros(3), UNKNOWN * np.eye(3), residual, reason, iterations)


def check_times(times: Array) -> Array:
    """(k,) s, rising; raises TtError."""
    times = check_array("times", times, (-1,))
    if (np.diff(times) <= 0.0).any():
        raise TtError(f"times must rise, got {times}")
    return times


def check_frames(frames: Sequence[Sequence[Image]], count: int, cameras: int) -> None:
    """Raises BadShape unless there are `count` images from each of `cameras` cameras."""
    if len(frames) != cameras or any(len(row) != count for row in frames):
        raise BadShape("frames", (len(frames), *(len(row) for row in frames)), f"{cameras} cameras x {count} frames")
