"""Which of the candidate strokes the arm makes.

For each candidate the stages are: racket state -> posture and joint speeds (`reach`) -> swing and its checks (`swing.strike`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from tt_core.failures import Failure
from tt_core.params import check, param
from tt_core.states import RacketState

from .joints import Joints
from .model import ArmModel
from .reach import METHODS, Reach, ReachParams, adjust, reach
from .swing import StrikePlan, Swing, SwingLimits, strike

HOPELESS = 0.1  # s too late, from where another posture would hardly be in time
LEAST_TIME, MOST_TIME = 0.05, 10.0  # s, swing times that postures are searched for
LESS_SPARE = 0.25  # of the spare time, in the second search: the search knows only nearly what the jerk limit takes


@dataclass(frozen=True, slots=True)
class SelectionParams:
    """How many of the candidates are tried, and how."""

    tries: int = param(6, "", "candidates that are tried until one can be made; 1 ms each", low=1, high=100)
    hurried: int = param(12, "", "candidates that are all tried when balls come one soon after the other", low=1, high=100)
    spare: float = param(0.02, "s", "time that the posture should leave to spare, if one can", low=0.0, high=1.0)
    method: str = param("best", "", "method of `reach`; liu is the dissertation's, for comparison", choices=METHODS)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


class SelectionFailure(Enum):
    """Why candidates were not tried."""

    NOT_TRIED = "candidates {first} to {last}: not tried"


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why a candidate is not taken.

    Attributes:
        failure: The reason.
        index: Of the candidate; None where the reason is not about one candidate.
        adjusted: Whether the swing on its way was adjusted to this candidate, and no new posture was searched.
    """

    failure: Failure
    index: int | None = None
    adjusted: bool = False

    def __str__(self) -> str:
        """Return the sentence, with the index of the candidate."""
        if self.index is None:
            return str(self.failure)
        return f"{self.index}{' adjusted' if self.adjusted else ''}: {self.failure}"


@dataclass(frozen=True, slots=True, eq=False)
class StrokeSelection:
    """A stroke that the arm can make in time, or why there is none.

    Attributes:
        index: Of the candidate; None when no candidate can be made.
        racket: The candidate, or None.
        reach: Its posture, or None.
        swing: Its swing, or None.
        reasons: Why the others that were tried cannot be made, in order.
        refused: Why none was tried, or None.
    """

    index: int | None
    racket: RacketState | None
    reach: Reach | None
    swing: Swing | None
    reasons: tuple[Refusal, ...]
    refused: Failure | None = None

    @classmethod
    def none(cls, reasons: Sequence[Refusal], refused: Failure | None = None) -> StrokeSelection:
        """Return the selection of no candidate."""
        return cls(None, None, None, None, tuple(reasons), refused)


def stroke_distance(one: RacketState, other: RacketState) -> float:
    """Return how far one stroke is from another (m), as it matters for a ball.

    It is the distance of the face centres at the other one's time, plus what the tilt makes over 2 cm and the speed in 5 ms.
    """
    position = one.position + one.velocity * (other.time - one.time)
    tilt, speed = np.linalg.norm(one.normal - other.normal), np.linalg.norm(one.velocity - other.velocity)
    return float(np.linalg.norm(position - other.position) + 0.02 * tilt + 0.005 * speed)


def select_stroke(
    model: ArmModel,
    rackets: Sequence[RacketState],
    start: Joints,
    limits: SwingLimits,
    reaching: ReachParams,
    params: SelectionParams,
    current: tuple[RacketState, Reach] | None = None,
    hurried: bool = False,
) -> StrokeSelection:
    """Select the first candidate that the arm can make from `start` in time, within its limits.

    Args:
        model: The arm.
        rackets: The candidates, in order of preference. One that is out of reach raises nothing: it is a reason.
        start: The motion from where the swing begins.
        limits: What the swing may use.
        reaching: What the posture search weighs.
        params: How many candidates are tried.
        current: The stroke on its way, which is adjusted to the nearest candidate where it can be.
        hurried: Whether another ball comes soon. Then the candidate is selected after which the arm waits again soonest.
    """
    reasons: list[Refusal] = []
    if current is not None and rackets:
        nearest = min(range(len(rackets)), key=lambda i: stroke_distance(current[0], rackets[i]))
        racket = rackets[nearest]
        target = adjust(model, racket, current[1], model.limits.reduced(speed=limits.speed_share))
        planned = strike(model, start, target, racket.time, limits)
        if planned.swing is not None:
            return StrokeSelection(nearest, racket, target, planned.swing, ())
        reasons += [Refusal(planned.failure, nearest, adjusted=True)] if planned.failure else []
    found: StrokeSelection | None = None
    tries = params.hurried if hurried else params.tries
    for i, racket in enumerate(rackets[:tries]):
        target, planned = _try(model, racket, start, limits, reaching, params)
        if planned.swing is None:
            reasons += [Refusal(planned.failure, i)] if planned.failure else []
        elif found is None or found.swing is None or planned.swing.end_time < found.swing.end_time:
            found = StrokeSelection(i, racket, target, planned.swing, ())
        if found is not None and not hurried:
            break
    if found is not None:
        return replace(found, reasons=tuple(reasons))
    if len(rackets) > tries:
        reasons.append(Refusal(Failure(SelectionFailure.NOT_TRIED, first=tries, last=len(rackets) - 1)))
    return StrokeSelection.none(reasons)


def _try(
    model: ArmModel, racket: RacketState, start: Joints, limits: SwingLimits, reaching: ReachParams, params: SelectionParams
) -> tuple[Reach, StrikePlan]:
    """Return posture and swing for one candidate; if it comes too late, those of a posture that is in time at any price."""
    left = racket.time - start.time - limits.ramp
    for spare, weight in ((params.spare, reaching.return_weight), (LESS_SPARE * params.spare, 0.0)):
        weighed = replace(
            reaching,
            swing_time=min(MOST_TIME, max(LEAST_TIME, left - spare)),
            acceleration=limits.acceleration,
            return_weight=weight,
            command_timeout=limits.hold,
        )
        joints = model.limits.reduced(speed=limits.speed_share)
        target = reach(model, racket, start.q, weighed, qdot=start.qdot, method=params.method, limits=joints)
        planned = strike(model, start, target, racket.time, limits)
        if planned.swing is not None or planned.earliest - racket.time > HOPELESS:
            break
    return target, planned
