"""The spin with its covariance, from the last registration of a burst."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
from tt_core.failures import Failure
from tt_core.states import Array

from .registration import GATE, LEAST_DISTINCTNESS, Registration

NOISE_FLOOR = (0.17, 5.5e-4)  # rad/s, and of the spin: standard deviation of what noise does not explain, light and centres
CORRELATED = 1.5  # neighbouring points share pixels: the least squares counts each pixel that often
CALIBRATED_LIGHT, NOT_REFINED, ONE_CAMERA = 0.75, 1.5, 3.0  # factors of NOISE_FLOOR; the second one holds without refined outlines
UNKNOWN = 1e6  # (rad/s)^2, variance of a spin that is not known


class SpinReason(Enum):
    """Why there is no estimate of the spin: codes of `tt_core.failures.Failure`."""

    FEW_FRAMES = "{frames} frames cannot tell a spin"
    NO_MARKS = "no marks on the ball"
    NO_AGREEMENT = "marks do not agree between frames (residual {residual:.2f})"
    AMBIGUOUS = "{count} spins fit the marks alike: {speeds} rad/s"
    INDISTINCT = "marks too few or too faint: they fit other spins nearly as well (distinctness {distinctness:.1f}, {bound:.1f} needed)"


@dataclass(frozen=True, eq=False)
class SpinEstimate:
    """The spin of the ball.

    Attributes:
        spin: (3,) rad/s in `table`; 0 without an estimate.
        covariance: (3, 3); large without an estimate, and for the dissertation's methods, which tell none.
        residual: 0 for marks that agree in all images, 1 for unrelated ones; of the dissertation's methods E (2.32) and V (2.21).
        reason: Why there is no estimate, or None.
        iterations: Rotations tried, or steps taken.
        alternatives: (n, 3) rad/s, the spins that fit alike if the reason is AMBIGUOUS, the best one first; empty otherwise.
    """

    spin: Array
    covariance: Array
    residual: float
    reason: Failure | None = None
    iterations: int = 0
    alternatives: Array = field(default_factory=lambda: np.empty((0, 3)))

    @classmethod
    def refused(cls, reason: Failure, residual: float = 1.0, iterations: int = 0) -> SpinEstimate:
        """Return that there is no estimate, and why."""
        return cls(np.zeros(3), UNKNOWN * np.eye(3), residual, reason, iterations)

    @classmethod
    def not_believed(cls, found: Registration) -> SpinEstimate:
        """Return that a registration is no estimate, and why."""
        if not found.agrees:
            return cls.refused(Failure(SpinReason.NO_AGREEMENT, residual=found.residual, bound=GATE), found.residual, found.candidates)
        if not found.is_distinct:
            bound = LEAST_DISTINCTNESS * found.residual
            reason = Failure(SpinReason.INDISTINCT, distinctness=found.distinctness, bound=bound)
            return cls.refused(reason, found.residual, found.candidates)
        spins = np.array([found.spin, *found.alternatives])
        speeds = ", ".join(f"{speed:.0f}" for speed in np.linalg.norm(spins, axis=1))
        refused = cls.refused(Failure(SpinReason.AMBIGUOUS, count=len(spins), speeds=speeds), found.residual, found.candidates)
        return replace(refused, alternatives=spins)

    @classmethod
    def without_covariance(cls, spin: Array, residual: float, iterations: int) -> SpinEstimate:
        """Return an estimate by a method that tells no covariance."""
        return cls(spin, UNKNOWN * np.eye(3), residual, None, iterations)


def estimate_from(found: Registration, *, cameras: int, is_refined: bool, is_light_calibrated: bool) -> SpinEstimate:
    """Return a registration's spin with its covariance: that of the least squares, and what noise does not explain.

    Without an estimate, but with the reason, if the registration is not believed.

    Args:
        found: The last registration of a burst.
        cameras: Number of cameras.
        is_refined: Whether outlines were found again with the marks known.
        is_light_calibrated: Whether the lamps are calibrated.
    """
    if not found.is_believed:
        return SpinEstimate.not_believed(found)
    factor = (NOT_REFINED if not is_refined else CALIBRATED_LIGHT if is_light_calibrated else 1.0) * (ONE_CAMERA if cameras == 1 else 1.0)
    floor = factor * np.hypot(NOISE_FLOOR[0], NOISE_FLOOR[1] * np.linalg.norm(found.spin))
    covariance = CORRELATED * np.linalg.inv(found.information) + floor**2 * np.eye(3)
    return SpinEstimate(found.spin, covariance, found.residual, None, found.candidates)
