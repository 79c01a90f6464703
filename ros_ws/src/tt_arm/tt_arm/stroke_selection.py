"""Select the candidate stroke that the arm makes.

A stroke is the racket's position, orientation and velocity at one time that returns the ball. For each candidate, `reach` computes posture
and joint speeds from the racket state, and `swing.strike` plans and checks the swing, the joint motion that makes the stroke.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple

from tt_core.failures import Failure
from tt_core.params import check, param
from tt_core.states import RacketState

from .joints import Joints
from .model import ArmModel
from .reach import REACH_METHODS, Reach, ReachFailure, ReachParams, reach
from .stroke_correction import by_distance, corrections, postures
from .swing import StrikePlan, Swing, SwingFailure, SwingLimits, return_time, strike

MOST_LATE = 0.1  # s; if the swing would be late by more than this, another posture would hardly be in time, so none is searched
LEAST_TIME, MOST_TIME = 0.05, 10.0  # s, bounds of the swing times for which postures are searched
ON_THE_WAY = {  # failures for which another posture may help although the arm would be in time
    SwingFailure.POSITION_LIMIT,
    SwingFailure.HELD_COMMAND,
    SwingFailure.CLEARANCE,
    SwingFailure.TORQUE_LIMIT,
}
LESS_SPARE = 0.25  # share of the spare time in the last search; not 0, because the search knows the effect of the jerk limit only roughly


@dataclass(frozen=True, slots=True)
class SelectionParams:
    """Parameters of the selection: how many candidate strokes are tried, and how their postures are searched."""

    tries: int = param(16, "", "candidates that are tried until one can be made; 1 ms each", low=1, high=100)
    hurried: int = param(12, "", "candidates that are all tried when balls come one soon after the other", low=1, high=100)
    corrections: int = param(
        3,
        "",
        "corrections of the stroke on its way that are tried, and candidates near it for which other postures are searched then; 1 ms each",
        low=1,
        high=100,
    )
    spare: float = param(0.02, "s", "time that the posture should leave to spare, if one can", low=0.0, high=1.0)
    margin: float = param(
        0.0, "", "share of the speed limits that a new posture keeps for corrections of its stroke, if it can", low=0.0, high=0.9
    )
    method: str = param("best", "", "method of `reach`; liu is the dissertation's, for comparison", choices=REACH_METHODS)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


class SelectionFailure(Enum):
    """Codes of failures for candidate strokes that were not tried."""

    NOT_TRIED = "candidates {first} to {last}: not tried"


class PlannedStroke(NamedTuple):
    """Racket state of a stroke, and the posture with its joint speeds that makes it."""

    racket: RacketState
    reach: Reach


@dataclass(frozen=True, slots=True)
class Refusal:
    """Reason why a candidate stroke is not made.

    Attributes:
        failure: The reason.
        index: Index of the candidate; None if the reason is not about a single candidate.
        adjusted: Whether only an adjustment of the present swing to this candidate was tried, without a search for a new posture.
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
    """Result of the selection: the stroke that the arm can make in time with its swing, or the reasons why there is none.

    Attributes:
        index: Index of the selected candidate; None if no candidate can be made.
        racket: Racket state of the selected stroke; None if there is none.
        reach: Posture and joint speeds at the strike; None if there is none.
        swing: Swing that makes the stroke; None if there is none.
        reasons: Why the other candidates that were tried cannot be made, in the order in which they were tried.
        refused: Why no candidate was tried at all; None if some were.
        corrects: Whether the stroke corrects the one that the arm moves for, because newer candidates for the same ball have come.
    """

    index: int | None
    racket: RacketState | None
    reach: Reach | None
    swing: Swing | None
    reasons: tuple[Refusal, ...]
    refused: Failure | None = None
    corrects: bool = False

    @classmethod
    def none(cls, reasons: Sequence[Refusal], refused: Failure | None = None) -> StrokeSelection:
        """Return the result without a stroke.

        Args:
            reasons: Why the candidates that were tried cannot be made.
            refused: Why no candidate was tried at all; None if some were.
        """
        return cls(None, None, None, None, tuple(reasons), refused)


def select_stroke(
    model: ArmModel,
    rackets: Sequence[RacketState],
    start: Joints,
    limits: SwingLimits,
    reaching: ReachParams,
    params: SelectionParams,
    current: PlannedStroke | None = None,
    hurried: bool = False,
) -> StrokeSelection:
    """Select the first candidate stroke that the arm can make from `start` in time and within its limits.

    If there is a current stroke, it is corrected towards the candidates (see `stroke_correction`). If that is not possible, new postures
    are searched, but only for the candidates nearest to it, and only such that the arm is in time: a correction must be quick.

    Args:
        model: The arm.
        rackets: Racket states of the candidates, in order of preference. A candidate out of reach raises no error, but becomes a reason.
        start: State of the joints at which the swing begins.
        limits: Limits that the swing must keep.
        reaching: Parameters of the posture search.
        params: How many candidates are tried.
        current: Racket state and posture of the stroke that the arm now moves for; None if there is none.
        hurried: Whether another ball comes soon. If so, up to `params.hurried` candidates are tried instead of `params.tries`.

    Returns:
        The selected stroke with its swing, or the reasons why there is none.
    """
    reasons: list[Refusal] = []
    tried: Sequence[int] = range(len(rackets))[: params.hurried if hurried else params.tries]
    efforts = _efforts(reaching, params)
    if current is not None:
        order = by_distance(rackets, current.racket)
        tried, efforts = order[: params.corrections], efforts[-1:]
        for change in corrections(rackets, order, current.racket)[: params.corrections]:
            for target in postures(model, change.racket, current.reach, model.limits.reduced(speed=limits.speed_share)):
                planned = strike(model, start, target, change.racket.time, limits)
                if planned.swing is not None:
                    return StrokeSelection(change.candidate, change.racket, target, planned.swing, tuple(reasons), corrects=True)
            reasons += [Refusal(planned.failure, change.candidate, adjusted=True)] if planned.failure else []
    for i in tried:
        target, planned = _try(model, rackets[i], start, limits, reaching, params.method, efforts)
        if planned.swing is not None:
            return StrokeSelection(i, rackets[i], target, planned.swing, tuple(reasons), corrects=current is not None)
        reasons += [Refusal(planned.failure, i)] if planned.failure else []
    if current is None and len(rackets) > len(tried):
        reasons.append(Refusal(Failure(SelectionFailure.NOT_TRIED, first=len(tried), last=len(rackets) - 1)))
    return StrokeSelection.none(reasons)


def select_sooner(
    model: ArmModel,
    rackets: Sequence[RacketState],
    start: Joints,
    limits: SwingLimits,
    reaching: ReachParams,
    params: SelectionParams,
    selected: StrokeSelection,
    go_on: Callable[[], bool],
) -> StrokeSelection:
    """Select, among the selected stroke and the other candidates, the one after which the arm waits for the next ball soonest.

    Args:
        model: The arm.
        rackets: Racket states of the candidates, in order of preference.
        start: State of the joints at which the swing begins.
        limits: Limits that the swing must keep.
        reaching: Parameters of the posture search.
        params: `params.hurried` is the number of candidates that are tried.
        selected: The selected stroke with its swing. Unless it corrects a stroke, the candidates before it are not tried.
        go_on: Called before each candidate; the selection ends if it returns False.

    Returns:
        `selected`, or the selection of another candidate whose swing ends earlier.
    """
    first = -1 if selected.index is None or selected.corrects else selected.index
    best, end = selected, selected.swing.end_time  # type: ignore[union-attr]
    effort = _usual(reaching, params)
    for i, racket in enumerate(rackets[first + 1 : params.hurried], first + 1):
        if not go_on():
            break
        target = _search(model, racket, start, limits, reaching, params.method, effort)
        if target.reason is not None or return_time(model, target, racket.time, limits) >= end:
            continue
        swing = strike(model, start, target, racket.time, limits).swing
        if swing is not None and swing.end_time < end:
            best, end = replace(selected, index=i, racket=racket, reach=target, swing=swing), swing.end_time
    return best


class _Effort(NamedTuple):
    """What a search for a posture aims at: s to spare, weight of the return time (1/s), share of the joint speeds kept as a margin."""

    spare: float
    return_weight: float
    margin: float


def _try(
    model: ArmModel,
    racket: RacketState,
    start: Joints,
    limits: SwingLimits,
    reaching: ReachParams,
    method: str,
    efforts: Sequence[_Effort],
) -> tuple[Reach, StrikePlan]:
    """Return posture and swing for one candidate.

    The searches `efforts` are made one after the other until one has a swing. If the arm would be in time, but not within its limits on the
    way, the posture nearest to `start` is tried before the next search: the arm moves least on its way there.
    """
    nearest: StrikePlan | None = None
    for effort in efforts:
        target = _search(model, racket, start, limits, reaching, method, effort)
        planned = strike(model, start, target, racket.time, limits)
        too_fast = target.reason is not None and target.reason.code is ReachFailure.BEYOND_SPEED_LIMIT
        if planned.swing is not None or (planned.earliest - racket.time > MOST_LATE and not (too_fast and effort.margin > 0.0)):
            break
        if nearest is None and planned.failure is not None and planned.failure.code in ON_THE_WAY:
            near = reach(model, racket, start.q, method="near", limits=model.limits.reduced(speed=limits.speed_share))
            nearest = strike(model, start, near, racket.time, limits)
            if nearest.swing is not None:
                return near, nearest
    return target, planned


def _search(
    model: ArmModel, racket: RacketState, start: Joints, limits: SwingLimits, reaching: ReachParams, method: str, effort: _Effort
) -> Reach:
    """Search the best posture for one candidate."""
    weighed = replace(
        reaching,
        swing_time=min(MOST_TIME, max(LEAST_TIME, racket.time - start.time - limits.ramp - effort.spare)),
        acceleration=limits.acceleration,
        return_weight=effort.return_weight,
        command_timeout=limits.hold,
    )
    joints = model.limits.reduced(speed=limits.speed_share * (1.0 - effort.margin))
    return reach(model, racket, start.q, weighed, qdot=start.qdot, method=method, limits=joints)


def _usual(reaching: ReachParams, params: SelectionParams) -> _Effort:
    """Return the usual search: with time to spare and a short return."""
    return _Effort(params.spare, reaching.return_weight, 0.0)


def _efforts(reaching: ReachParams, params: SelectionParams) -> list[_Effort]:
    """Return the searches for the posture of one candidate, in turn.

    The first ones keep a margin of the joint speeds, time to spare and a short return. The last one uses all that the limits permit, to be
    in time.
    """
    usual = _usual(reaching, params)
    with_margin = [usual._replace(margin=params.margin)] if params.margin > 0.0 else []
    return [*with_margin, usual, _Effort(LESS_SPARE * params.spare, 0.0, 0.0)]
