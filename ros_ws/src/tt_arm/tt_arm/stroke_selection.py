"""Which of the candidate strokes the arm makes.

For each candidate the stages are: racket state -> posture and joint speeds (`reach`) -> swing and its checks (`swing.strike`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

from tt_core.failures import Failure
from tt_core.params import check, param
from tt_core.states import RacketState

from .joints import Joints
from .model import ArmModel
from .reach import METHODS, Reach, ReachFailure, ReachParams, reach
from .stroke_correction import corrections, postures
from .swing import StrikePlan, Swing, SwingLimits, strike

HOPELESS = 0.1  # s too late, from where another posture would hardly be in time
LEAST_TIME, MOST_TIME = 0.05, 10.0  # s, swing times that postures are searched for
LESS_SPARE = 0.25  # of the spare time, in the second search: the search knows only nearly what the jerk limit takes


@dataclass(frozen=True, slots=True)
class SelectionParams:
    """How many of the candidates are tried, and how."""

    tries: int = param(16, "", "candidates that are tried until one can be made; 1 ms each", low=1, high=100)
    hurried: int = param(12, "", "candidates that are all tried when balls come one soon after the other", low=1, high=100)
    corrections: int = param(
        4, "", "corrections of the stroke on its way that are tried before another posture is searched; 1 ms each", low=1, high=100
    )
    spare: float = param(0.02, "s", "time that the posture should leave to spare, if one can", low=0.0, high=1.0)
    margin: float = param(
        0.0, "", "share of the speed limits that a new posture keeps for corrections of its stroke, if it can", low=0.0, high=0.9
    )
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
        current: The stroke on its way, which is corrected where it can be, see `stroke_correction`.
        hurried: Whether another ball comes soon. Then `select_sooner` may follow, so that as many are tried as it tries.
    """
    reasons: list[Refusal] = []
    if current is not None:
        for change in corrections(rackets, current[0])[: params.corrections]:
            for target in postures(model, change.racket, current[1], model.limits.reduced(speed=limits.speed_share)):
                planned = strike(model, start, target, change.racket.time, limits)
                if planned.swing is not None:
                    return StrokeSelection(change.candidate, change.racket, target, planned.swing, tuple(reasons))
            reasons += [Refusal(planned.failure, change.candidate, adjusted=True)] if planned.failure else []
    tries = params.hurried if hurried else params.tries
    for i, racket in enumerate(rackets[:tries]):
        target, planned = _try(model, racket, start, limits, reaching, params)
        if planned.swing is not None:
            return StrokeSelection(i, racket, target, planned.swing, tuple(reasons))
        reasons += [Refusal(planned.failure, i)] if planned.failure else []
    if len(rackets) > tries:
        reasons.append(Refusal(Failure(SelectionFailure.NOT_TRIED, first=tries, last=len(rackets) - 1)))
    return StrokeSelection.none(reasons)


def select_sooner(
    model: ArmModel,
    rackets: Sequence[RacketState],
    start: Joints,
    limits: SwingLimits,
    reaching: ReachParams,
    params: SelectionParams,
    selected: StrokeSelection,
) -> StrokeSelection:
    """Select, of a selection and the candidates after it, the one after which the arm waits again soonest.

    Args:
        model: See `select_stroke`.
        rackets: See `select_stroke`.
        start: See `select_stroke`.
        limits: See `select_stroke`.
        reaching: See `select_stroke`.
        params: See `select_stroke`.
        selected: The first candidate that the arm can make.
    """
    first: int = selected.index  # type: ignore[assignment]
    best, end = selected, selected.swing.end_time  # type: ignore[union-attr]
    for i, racket in enumerate(rackets[first + 1 : params.hurried], first + 1):
        target, planned = _try(model, racket, start, limits, reaching, params)
        if planned.swing is not None and planned.swing.end_time < end:
            best, end = replace(selected, index=i, racket=racket, reach=target, swing=planned.swing), planned.swing.end_time
    return best


def _try(
    model: ArmModel, racket: RacketState, start: Joints, limits: SwingLimits, reaching: ReachParams, params: SelectionParams
) -> tuple[Reach, StrikePlan]:
    """Return posture and swing for one candidate; if it comes too late, those of a posture that is in time at any price.

    The first posture keeps `params.margin` of the joint speeds; where there is none, and if it comes too late, all of them may be used.
    """
    left = racket.time - start.time - limits.ramp
    for spare, weight, margin in _efforts(reaching, params):
        weighed = replace(
            reaching,
            swing_time=min(MOST_TIME, max(LEAST_TIME, left - spare)),
            acceleration=limits.acceleration,
            return_weight=weight,
            command_timeout=limits.hold,
        )
        joints = model.limits.reduced(speed=limits.speed_share * (1.0 - margin))
        target = reach(model, racket, start.q, weighed, qdot=start.qdot, method=params.method, limits=joints)
        planned = strike(model, start, target, racket.time, limits)
        too_fast = target.reason is not None and target.reason.code is ReachFailure.BEYOND_SPEED_LIMIT
        if planned.swing is not None or (planned.earliest - racket.time > HOPELESS and not (too_fast and margin > 0.0)):
            break
    return target, planned


def _efforts(reaching: ReachParams, params: SelectionParams) -> list[tuple[float, float, float]]:
    """Return time to spare (s), weight of the time home (1/s) and margin of the joint speeds of each search, in turn."""
    usual = params.spare, reaching.return_weight
    with_margin = [(*usual, params.margin)] if params.margin > 0.0 else []
    return [*with_margin, (*usual, 0.0), (LESS_SPARE * params.spare, 0.0, 0.0)]
