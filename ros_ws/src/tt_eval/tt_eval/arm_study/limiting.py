"""Names for what limits an arm, by the codes of its failures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from tt_arm.reach import ReachFailure
from tt_arm.swing import SwingFailure

# name of the limit for each code; {joint} is replaced by the joint that the failure names
LIMITING = {
    ReachFailure.OUT_OF_REACH: "reach: no posture holds the racket there",
    ReachFailure.NOT_CONVERGED: "reach: no posture holds the racket there",
    ReachFailure.BEYOND_POSITION_LIMIT: "range of {joint}",
    ReachFailure.BEYOND_SPEED_LIMIT: "joint speeds",
    SwingFailure.TOO_SOON: "time: the swing takes too long",
    SwingFailure.TOO_LATE: "time: the swing cannot wait",
    SwingFailure.TOO_FAST: "time: the swing cannot wait",
    SwingFailure.NO_WAY: "time: no swing within the limits",
    SwingFailure.NO_WAY_BACK: "time: no way back",
    SwingFailure.POSITION_LIMIT: "range of {joint}",
    SwingFailure.HELD_COMMAND: "range of {joint}, with the room that a held command needs",
    SwingFailure.SPEED_LIMIT: "speed of {joint}",
    SwingFailure.ACCELERATION_LIMIT: "acceleration of {joint}",
    SwingFailure.JERK_LIMIT: "jerk of {joint}",
    SwingFailure.TORQUE_LIMIT: "effort of {joint}",
    SwingFailure.CLEARANCE: "clearance to table, floor or itself",
}
_BY_NAME = {code.name: text for code, text in LIMITING.items()}


def limiting(limits: Iterable[tuple[str, str]]) -> dict[str, int]:
    """Return how often each thing limits, the most frequent first.

    Args:
        limits: Columns `limit` and `limit_joint` of a sweep; those without a code do not count.
    """
    counts: Counter[str] = Counter()
    for name, joint in limits:
        if name:
            counts[_BY_NAME.get(name, name).format(joint=joint)] += 1
    return dict(counts.most_common())
