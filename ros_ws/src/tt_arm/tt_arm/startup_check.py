"""Whether an arm with this base, mount and waiting posture can play at all; told at the start, with numbers."""

from __future__ import annotations

import numpy as np
from tt_core.errors import TtError
from tt_core.states import RacketState

from .joints import Joints
from .model import ArmModel
from .reach import reach
from .safety.clearance import OBSTACLES, clearance
from .swing import SwingLimits, plan

TIME = 1.0  # s, for each stroke, without hurry
NEEDED = 0.5  # share of the strokes that must be possible; all of them are from the base, mount and posture of `model`


def strokes() -> list[RacketState]:
    """Typical ones over the window in which balls are hit (dissertation Section 4.5.1), with the middle of the printed velocities."""
    velocity = np.array([1.2, 0.0, 1.3])
    places = [(x, y, z) for x in (-0.25, -0.05) for y in (0.45, 0.76, 1.07) for z in (0.2, 0.4)]
    return [RacketState(TIME, np.array(place), velocity, 0.0, 1.2) for place in places]


def check_feasible(model: ArmModel, limits: SwingLimits) -> None:
    """Raises TtError when the waiting posture touches something or fewer than NEEDED of `strokes` can be made."""
    left, what = clearance(model.waiting, model.chain)
    if left < limits.clearance:
        raise TtError(
            f"waiting = {model.waiting.tolist()} is {1e3 * left:.0f} mm from {OBSTACLES[what]}, {1e3 * limits.clearance:g} mm wanted"
        )
    start, tried = Joints(0.0, model.waiting, np.zeros(7)), strokes()
    reasons = [plan(model, start, reach(model, racket, model.waiting), TIME, limits).reason for racket in tried]
    made = reasons.count(None)
    if made < NEEDED * len(tried):
        x, y, z = model.chain.base_position
        far = max(float(np.linalg.norm(r.position - (x, y, z + model.chain.lengths[0]))) for r in tried)
        span = float(model.chain.lengths[1:].sum() + np.linalg.norm(model.chain.mount_position))
        first = next(reason for reason in reasons if reason is not None)
        raise TtError(
            f"base = ({x:g}, {y:g}, {z:g}) with this mount makes {made} of {len(tried)} strokes, {NEEDED * len(tried):.0f} needed: "
            f"{first}; "
            f"the furthest is {far:.2f} m from the shoulder, the arm {span:.2f} m long"
        )
