"""Correct the stroke that the arm now moves for, towards newer candidate strokes.

The best correction is the whole change to the candidate for the same time. If the arm cannot make it in time, candidates for neighbouring
times are tried, and then half of the change, after which the remaining error is smaller than without a correction.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from tt_core.states import Array, RacketState

from .joints import JointLimits
from .model import ArmModel
from .reach import Reach, adjust, reach

NEIGHBOURS = 2  # number of candidates that are tried before half of the change
SAME_TIME = 1e-4  # s, largest difference between two strikes that count as being at the same time


class Correction(NamedTuple):
    """A changed stroke that may replace the one that the arm now moves for.

    Attributes:
        candidate: Index of the candidate towards which the stroke is changed.
        racket: Racket state of the changed stroke: the candidate, or the middle between it and the present stroke.
    """

    candidate: int
    racket: RacketState


def stroke_distances(current: RacketState, rackets: Sequence[RacketState]) -> Array:
    """Return a measure (n,) in m of the differences between one stroke and n others.

    It is the distance of the face centres at the time of the other stroke, plus 0.02 m times the difference of the unit normals, plus 5 ms
    times the difference of the velocities.
    """
    times = np.array([racket.time for racket in rackets])
    positions, velocities, normals = (
        np.array([getattr(racket, name) for racket in rackets]).reshape(-1, 3) for name in ("position", "velocity", "normal")
    )
    then = current.position + current.velocity * (times - current.time)[:, None]
    off, turned, changed = then - positions, current.normal - normals, current.velocity - velocities
    distances: Array = np.linalg.norm([off, 0.02 * turned, 0.005 * changed], axis=2).sum(axis=0)
    return distances


def by_distance(rackets: Sequence[RacketState], current: RacketState) -> list[int]:
    """Return the indices of newer candidates, the nearest to the stroke that the arm now moves for first; see `stroke_distances`."""
    order: list[int] = np.argsort(stroke_distances(current, rackets), kind="stable").tolist()
    return order


def corrections(rackets: Sequence[RacketState], order: Sequence[int], current: RacketState) -> list[Correction]:
    """Return the possible corrections of a stroke, in order of preference.

    Args:
        rackets: Racket states of the newer candidates.
        order: Their indices, as `by_distance` returns them.
        current: Racket state of the stroke that the arm now moves for.

    Returns:
        First the NEIGHBOURS candidates nearest to the current stroke, then half of the change to candidates for the same time, then the
        other candidates.
    """
    full = [Correction(i, rackets[i]) for i in order]
    same = [one for one in full if abs(one.racket.time - current.time) < SAME_TIME]
    return [*full[:NEIGHBOURS], *(Correction(one.candidate, between(current, one.racket)) for one in same), *full[NEIGHBOURS:]]


def between(current: RacketState, racket: RacketState) -> RacketState:
    """Return the racket state in the middle between two strokes at the same time: mean position, velocity and normal."""
    position, velocity = 0.5 * (current.position + racket.position), 0.5 * (current.velocity + racket.velocity)
    normal = current.normal + racket.normal
    return RacketState.facing(racket.time, position, velocity, normal / np.linalg.norm(normal))


def postures(model: ArmModel, racket: RacketState, before: Reach, limits: JointLimits) -> Iterator[Reach]:
    """Yield two postures for a changed stroke, both near the posture of the stroke before the change.

    The first changes joint positions and speeds as little as possible (`reach.adjust`); the second has the least joint speeds.

    Args:
        model: The arm.
        racket: Racket state of the changed stroke.
        before: Posture and joint speeds of the stroke before the change.
        limits: Limits of the joints.
    """
    yield adjust(model, racket, before, limits)
    yield reach(model, racket, before.q, method="near", limits=limits)
