"""Whether an arm with this base, mount and waiting posture can play at all. Checked at the start, reported with numbers."""

from __future__ import annotations

from enum import Enum

import numpy as np
from tt_core.errors import TtError
from tt_core.failures import Failure
from tt_core.states import RacketState

from .joints import Joints
from .model import ArmModel
from .reach import reach
from .safety.clearance import OBSTACLES, clearance
from .swing import SwingLimits, plan

TIME = 1.0  # s from the start to the strike; enough for every stroke that is within reach
NEEDED = 0.5  # share of the strokes that must be possible; from the base, mount and posture of `model` all of them are


class StartupFailure(Enum):
    """Why an arm cannot play."""

    WAITING_TOO_NEAR = "the waiting posture {waiting} is {distance:.3f} m from {obstacle}, {bound:g} m wanted"
    TOO_FEW_STROKES = (
        "base = ({x:g}, {y:g}, {z:g}) with this mount makes {made} of {tried} strokes, {needed:.0f} needed: {reason}; "
        "the furthest is {far:.2f} m from the shoulder, the arm is {length:.2f} m long"
    )


class StartupError(TtError):
    """The arm cannot play.

    Attributes:
        failure: The reason.
    """

    def __init__(self, failure: Failure) -> None:
        """Keep the reason; its sentence is the text of the error."""
        super().__init__(str(failure))
        self.failure = failure


def strokes() -> list[RacketState]:
    """Return typical strokes over the window in which balls are hit.

    Positions: dissertation Section 4.5.1. Velocity: the middle of the printed ones.
    """
    velocity = np.array([1.2, 0.0, 1.3])
    places = [(x, y, z) for x in (-0.25, -0.05) for y in (0.45, 0.76, 1.07) for z in (0.2, 0.4)]
    return [RacketState(TIME, np.array(place), velocity, 0.0, 1.2) for place in places]


def check_feasible(model: ArmModel, limits: SwingLimits) -> None:
    """Check that the waiting posture touches nothing and that enough of `strokes` can be made.

    Args:
        model: The arm.
        limits: What swings may use.

    Raises:
        StartupError: The waiting posture is too near to something, or fewer than NEEDED of the strokes can be made.
    """
    left, what = clearance(model.waiting, model.chain)
    if left < limits.clearance:
        raise StartupError(
            Failure(
                StartupFailure.WAITING_TOO_NEAR,
                waiting=model.waiting.tolist(),
                distance=left,
                obstacle=OBSTACLES[what],
                bound=limits.clearance,
            )
        )
    start, tried = Joints(0.0, model.waiting, np.zeros(7)), strokes()
    reasons = [plan(model, start, reach(model, racket, model.waiting), TIME, limits).reason for racket in tried]
    made = reasons.count(None)
    if made < NEEDED * len(tried):
        x, y, z = model.chain.base_position
        shoulder = np.array([x, y, z + model.chain.lengths[0]])
        raise StartupError(
            Failure(
                StartupFailure.TOO_FEW_STROKES,
                x=x, y=y, z=z, made=made, tried=len(tried), needed=NEEDED * len(tried),
                reason=next(reason for reason in reasons if reason is not None),
                far=max(float(np.linalg.norm(racket.position - shoulder)) for racket in tried),
                length=float(model.chain.lengths[1:].sum() + np.linalg.norm(model.chain.mount_position)),
            )
        )  # fmt: skip
