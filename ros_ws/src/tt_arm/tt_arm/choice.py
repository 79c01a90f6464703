"""Which of the candidate strokes the arm takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from tt_core.errors import TtError, check_range
from tt_core.states import RacketState

from .model import ArmModel
from .reach import Reach, ReachParams, adjust, reach
from .swing import Joints, Swing, SwingLimits, plan


@dataclass(frozen=True, slots=True)
class ChoiceParams:
    """How long the arm looks among the candidates."""

    tries: int = 6  # candidates that are worked out, 3 ms each
    spare: float = 0.02  # s, that the strike should be later than the earliest possible; the first such candidate is taken at once
    method: str = "best"  # of `reach`; "liu" for comparison

    def __post_init__(self) -> None:
        check_range("tries", self.tries, 1, 100)
        check_range("spare", self.spare, 0.0, 1.0)
        if self.method not in ("best", "near", "liu"):
            raise TtError(f"method {self.method!r} is none of best, near, liu")


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """A stroke that the arm can make in time.

    index: of the candidate; None when no candidate can be taken. reasons: of the others that were tried, in order.
    """

    index: int | None
    racket: RacketState | None
    reach: Reach | None
    swing: Swing | None
    reasons: tuple[str, ...]


def apart(one: RacketState, other: RacketState) -> float:
    """m, how far `one` passes from where `other` wants the face, plus what its tilt makes over 2 cm and its speed in 5 ms."""
    position = one.position + one.velocity * (other.time - one.time)
    tilt, speed = np.linalg.norm(one.normal - other.normal), np.linalg.norm(one.velocity - other.velocity)
    return float(np.linalg.norm(position - other.position) + 0.02 * tilt + 0.005 * speed)


def choose(
    model: ArmModel,
    rackets: Sequence[RacketState],
    start: Joints,
    limits: SwingLimits,
    reaching: ReachParams,
    params: ChoiceParams,
    current: tuple[RacketState, Reach] | None = None,
) -> Choice:
    """The first candidate that the arm can make from `start` with time to spare, else the one with most time, within its limits.

    current: the stroke on its way, adjusted where it can be. A stroke out of reach raises nothing: it is a reason.
    """
    reasons: list[str] = []
    if current is not None and rackets:
        nearest = min(range(len(rackets)), key=lambda i: apart(current[0], rackets[i]))
        target = adjust(model, rackets[nearest], current[1])
        swing = plan(model, start, target, rackets[nearest].time, limits)
        if swing.reason is None:
            return Choice(nearest, rackets[nearest], target, swing, ())
        reasons.append(f"{nearest} adjusted: {swing.reason}")
    best, most = Choice(None, None, None, None, ()), -np.inf
    for i, racket in enumerate(rackets[: params.tries]):
        left = min(10.0, max(0.05, racket.time - start.time - params.spare))
        target = reach(
            model,
            racket,
            start.q,
            replace(reaching, swing_time=left, acceleration=limits.acceleration),
            qdot=start.qdot,
            method=params.method,
        )
        swing = plan(model, start, target, racket.time, limits)
        spare = racket.time - swing.earliest
        if swing.reason is None and spare > most:
            best, most = Choice(i, racket, target, swing, ()), spare
        if most >= params.spare:
            break
        reasons.append(f"{i}: {swing.reason or f'only {1e3 * spare:.0f} ms to spare'}")
    return replace(best, reasons=tuple(reasons))
