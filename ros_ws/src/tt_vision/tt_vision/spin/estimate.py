"""The estimate of the spin with its covariance, from the last registration of a burst.

A burst holds the images of one ball's passage through the high speed cameras. A registration is a spin, and how well the ball's marks (the
printed or drawn dots) agree in all images with this spin.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
from tt_core.failures import Failure
from tt_core.states import UNKNOWN_VARIANCE, Array

from ..detection.outline import blur_scale
from .registration import GATE, LEAST_DISTINCTNESS, MOST_DISPARITY, Registration

# standard deviation by errors of the light and of the ball's centre
NOISE_FLOOR = 0.17  # rad/s
RELATIVE_NOISE_FLOOR = 5.5e-4  # relative to the spin
CORRELATED = 1.5  # how often the least-squares fit counts each pixel, because neighbouring points share pixels
# factors on both; the second one if outlines were not found again
CALIBRATED_LIGHT_NOISE, NOT_REFINED_NOISE, ONE_CAMERA_NOISE = 0.75, 1.5, 3.0


class SpinReason(Enum):
    """Reasons why there is no estimate of the spin; codes of `tt_core.failures.Failure`."""

    FEW_FRAMES = "{frames} frames cannot tell a spin"
    NO_MARKS = "no marks on the ball"
    NO_AGREEMENT = "marks do not agree between frames (residual {residual:.2f})"
    AMBIGUOUS = "{count} spins fit the marks alike: {speeds} rad/s"
    INCONSISTENT = "parts of the images tell spins that differ by {disparity:.3f} rad per frame, at most {bound:.3f} is allowed"
    INDISTINCT = "marks too few or too faint: they fit other spins nearly as well (distinctness {distinctness:.1f}, {bound:.1f} needed)"


@dataclass(frozen=True, eq=False)
class SpinEstimate:
    """Estimate of the spin of the ball, or the reason why there is none.

    Attributes:
        spin: (3,) rad/s in `table`; 0 if there is no estimate.
        covariance: (3, 3) (rad/s)^2. It is large if there is no estimate, and for the dissertation's methods, which give no covariance.
        residual: Disagreement of the ball's marks (dots) between the images: 0 if they agree, 1 if they are unrelated. For the
            dissertation's Method 1 it is V of (2.21), for Method 2 it is E of (2.32).
        reason: Why there is no estimate; None if there is one.
        iterations: Number of rotations that were tried; of the dissertation's methods the number of iterations.
        alternatives: (n, 3) rad/s, the spins that fit equally well if the reason is AMBIGUOUS, the best one first; empty otherwise.
    """

    spin: Array
    covariance: Array
    residual: float
    reason: Failure | None = None
    iterations: int = 0
    alternatives: Array = field(default_factory=lambda: np.empty((0, 3)))

    @classmethod
    def refused(cls, reason: Failure, residual: float = 1.0, iterations: int = 0) -> SpinEstimate:
        """Return a result without an estimate.

        Args:
            reason: Why there is none.
            residual: See `SpinEstimate.residual`.
            iterations: See `SpinEstimate.iterations`.
        """
        return cls(np.zeros(3), UNKNOWN_VARIANCE * np.eye(3), residual, reason, iterations)

    @classmethod
    def not_believed(cls, found: Registration) -> SpinEstimate:
        """Return a result without an estimate for a registration that is not believed, with the reason why it is not.

        Args:
            found: The registration, of which `is_believed` is False.
        """
        if not found.agrees:
            return cls.refused(Failure(SpinReason.NO_AGREEMENT, residual=found.residual, bound=GATE), found.residual, found.candidates)
        if not found.is_distinct:
            bound = LEAST_DISTINCTNESS * found.residual
            reason = Failure(SpinReason.INDISTINCT, distinctness=found.distinctness, bound=bound)
            return cls.refused(reason, found.residual, found.candidates)
        if len(found.alternatives):
            spins = np.array([found.spin, *found.alternatives])
            speeds = ", ".join(f"{speed:.0f}" for speed in np.linalg.norm(spins, axis=1))
            refused = cls.refused(Failure(SpinReason.AMBIGUOUS, count=len(spins), speeds=speeds), found.residual, found.candidates)
            return replace(refused, alternatives=spins)
        reason = Failure(SpinReason.INCONSISTENT, disparity=found.disparity, bound=MOST_DISPARITY)
        return cls.refused(reason, found.residual, found.candidates)

    @classmethod
    def without_covariance(cls, spin: Array, residual: float, iterations: int) -> SpinEstimate:
        """Return an estimate by a method that gives no covariance; a large one is used.

        Args:
            spin: (3,) rad/s in `table`.
            residual: See `SpinEstimate.residual`.
            iterations: See `SpinEstimate.iterations`.
        """
        return cls(spin, UNKNOWN_VARIANCE * np.eye(3), residual, None, iterations)


def estimate_from(found: Registration, *, cameras: int, is_refined: bool, is_light_calibrated: bool, blur: float) -> SpinEstimate:
    """Convert a registration (a spin with which the ball's marks agree in all images) to an estimate of the spin with its covariance.

    The covariance is that of the least-squares fit, plus a part for errors of the light and of the ball's centre.

    Args:
        found: The last registration of a burst.
        cameras: Number of cameras.
        is_refined: Whether the outlines were found again once the marks were known.
        is_light_calibrated: Whether the lamps are calibrated.
        blur: Sigma of lens and motion in the images, pixels. The errors of light and centre grow with its square.

    Returns:
        The estimate; if the registration is not believed, a result without an estimate, with the reason.
    """
    if not found.is_believed:
        return SpinEstimate.not_believed(found)
    factor = (NOT_REFINED_NOISE if not is_refined else CALIBRATED_LIGHT_NOISE if is_light_calibrated else 1.0) * (
        ONE_CAMERA_NOISE if cameras == 1 else 1.0
    )
    floor = factor * blur_scale(blur) ** 2 * np.hypot(NOISE_FLOOR, RELATIVE_NOISE_FLOOR * np.linalg.norm(found.spin))
    covariance = CORRELATED * np.linalg.inv(found.information) + floor**2 * np.eye(3)
    return SpinEstimate(found.spin, covariance, found.residual, None, found.candidates)
