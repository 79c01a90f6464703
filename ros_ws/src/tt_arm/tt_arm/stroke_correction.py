"""How the stroke on its way may be changed for newer candidates: to which of them, how far, and with which posture.

The best correction goes all the way to the candidate for the same time. Where the arm cannot do that in time, candidates for neighbouring
times are next, and then half of the way, which leaves less than none.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from tt_core.states import RacketState

from .joints import JointLimits
from .model import ArmModel
from .reach import Reach, adjust, reach

NEIGHBOURS = 2  # candidates that are tried before half of the way
SAME_TIME = 1e-4  # s between two strikes that are at the same time


class Correction(NamedTuple):
    """A change of the stroke on its way.

    Attributes:
        candidate: Its index.
        racket: The candidate, or what lies between it and the stroke on its way.
    """

    candidate: int
    racket: RacketState


def stroke_distance(one: RacketState, other: RacketState) -> float:
    """Return how far one stroke is from another (m), as it matters for a ball.

    It is the distance of the face centres at the other one's time, plus what the tilt makes over 2 cm and the speed in 5 ms.
    """
    position = one.position + one.velocity * (other.time - one.time)
    tilt, speed = np.linalg.norm(one.normal - other.normal), np.linalg.norm(one.velocity - other.velocity)
    return float(np.linalg.norm(position - other.position) + 0.02 * tilt + 0.005 * speed)


def corrections(rackets: Sequence[RacketState], current: RacketState) -> list[Correction]:
    """Return the corrections of a stroke, in order of preference.

    Args:
        rackets: The newer candidates.
        current: The stroke on its way.
    """
    order = sorted(range(len(rackets)), key=lambda i: stroke_distance(current, rackets[i]))
    full = [Correction(i, rackets[i]) for i in order]
    same = [one for one in full if abs(one.racket.time - current.time) < SAME_TIME]
    return [*full[:NEIGHBOURS], *(Correction(one.candidate, between(current, one.racket)) for one in same), *full[NEIGHBOURS:]]


def between(current: RacketState, racket: RacketState) -> RacketState:
    """Return the racket half-way between two strokes at the same time."""
    position, velocity = 0.5 * (current.position + racket.position), 0.5 * (current.velocity + racket.velocity)
    normal = current.normal + racket.normal
    return RacketState.facing(racket.time, position, velocity, normal / np.linalg.norm(normal))


def postures(model: ArmModel, racket: RacketState, before: Reach, limits: JointLimits) -> Iterator[Reach]:
    """Yield postures for a stroke that was changed: with the least change, and with the least joint speeds near the posture before.

    Args:
        model: The arm.
        racket: As wanted now.
        before: The posture of the stroke before.
        limits: Of the joints.
    """
    yield adjust(model, racket, before, limits)
    yield reach(model, racket, before.q, method="near", limits=limits)
