"""Which of the candidate strokes the arm takes."""

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
from .reach import Reach, ReachParams, adjust, reach
from .swing import Swing, SwingLimits, strike

HOPELESS = 0.1  # s too late, from where another posture would hardly be in time


@dataclass(frozen=True, slots=True)
class SelectionParams:
    """How long the arm looks among the candidates."""

    tries: int = param(6, "", "candidates that are worked out until one can be made, 1 ms each", low=1, high=100)
    hurried: int = param(12, "", "candidates that are all worked out when balls come one after the other", low=1, high=100)
    spare: float = param(0.02, "s", "that the posture should leave to spare, if there is one", low=0.0, high=1.0)
    method: str = param("best", "", "method of `reach`; liu is the dissertation's, for comparison", choices=("best", "near", "liu"))

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


class SelectionFailure(Enum):
    """Why a candidate was not worked out."""

    NOT_TRIED = "candidates {first} to {last}: not tried"


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why a candidate is not taken.

    Attributes:
        failure: The reason.
        index: Of the candidate; None where the reason is none of one candidate.
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
    """A stroke that the arm can make in time.

    index: of the candidate; None when no candidate can be taken. reasons: of the others that were tried, in order. refused: why none was
    tried, or None.
    """

    index: int | None
    racket: RacketState | None
    reach: Reach | None
    swing: Swing | None
    reasons: tuple[Refusal, ...]
    refused: Failure | None = None


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
    params: SelectionParams,
    current: tuple[RacketState, Reach] | None = None,
    hurried: bool = False,
) -> StrokeSelection:
    """The first candidate that the arm can make from `start` in time, within its limits.

    current: the stroke on its way, adjusted where it can be. hurried: the candidate after which the arm waits again soonest instead, for
    another ball comes at once. A stroke out of reach raises nothing: it is a reason.
    """
    reasons: list[Refusal] = []
    if current is not None and rackets:
        nearest = min(range(len(rackets)), key=lambda i: apart(current[0], rackets[i]))
        target = adjust(model, rackets[nearest], current[1])
        swing, _, reason = strike(model, start, target, rackets[nearest].time, limits)
        if swing is not None:
            return StrokeSelection(nearest, rackets[nearest], target, swing, ())
        if reason is not None:
            reasons.append(Refusal(reason, nearest, adjusted=True))
    found: tuple[int, RacketState, Reach, Swing] | None = None
    tries = params.hurried if hurried else params.tries
    for i, racket in enumerate(rackets[:tries]):
        left = racket.time - start.time - limits.ramp
        # at the last in time at any price; the search knows what the jerk limit takes only nearly, hence a quarter
        for spare, weight in ((params.spare, reaching.return_weight), (0.25 * params.spare, 0.0)):
            time = min(10.0, max(0.05, left - spare))
            timeout = limits.command_timeout
            given = replace(reaching, swing_time=time, acceleration=limits.acceleration, return_weight=weight, command_timeout=timeout)
            target = reach(model, racket, start.q, given, qdot=start.qdot, method=params.method)
            swing, earliest, reason = strike(model, start, target, racket.time, limits)
            if swing is not None or earliest - racket.time > HOPELESS:
                break
        if swing is None:
            if reason is not None:
                reasons.append(Refusal(reason, i))
        elif found is None or swing.end_time < found[3].end_time:
            found = i, racket, target, swing
        if found is not None and not hurried:
            break
    if found is not None:
        return StrokeSelection(*found, tuple(reasons))
    if len(rackets) > tries:
        reasons.append(Refusal(Failure(SelectionFailure.NOT_TRIED, first=tries, last=len(rackets) - 1)))
    return StrokeSelection(None, None, None, None, tuple(reasons))
