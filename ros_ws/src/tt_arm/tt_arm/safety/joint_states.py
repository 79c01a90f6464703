"""Check of joint states: one that is invalid, old, repeated or impossible is refused before anything is computed from it.

Ages are checked twice: by the stamp against its clock, and by the time of arrival on a monotonic clock. The deadline after which joint
states count as having ceased depends on the time of arrival only.
"""

from __future__ import annotations

import math
import statistics
from collections import deque
from dataclasses import dataclass

import numpy as np
from tt_core.failures import Failure
from tt_core.params import check, param
from tt_core.states import Array

from ..joints import Joints
from ..model import ArmModel
from .stops import ArmStop

MOST_LIMIT_EXCESS = 1.0  # rad or m; a number further beyond a position limit is no position: the mechanical stops are nearer
TIMES = 10.0  # a number larger than this multiple of the speed limit cannot be a speed of this joint
JUMP = 0.02  # rad or m, difference of two positions that noise may cause beyond what the speed limits permit
LONGEST_DEADLINE = 0.3  # s, upper bound of the deadline, whatever the period of the joint states is
PERIOD_WINDOW = 15  # number of intervals between joint states whose median is their period


@dataclass(frozen=True, slots=True)
class JointStateParams:
    """Parameters that decide which joint states are accepted, and when they count as having ceased."""

    silence: float = param(
        0.020, "s", "time without a valid joint state after which the arm brakes; checked each 2.5 ms", low=0.001, high=10.0
    )
    periods: float = param(
        3.0,
        "",
        "periods of the joint states without a valid one after which the arm brakes, where that is longer than `silence`",
        low=1.0,
        high=100.0,
    )
    late: float = param(
        0.1, "s", "age that a joint state may have when it comes; a busy machine delays some by 50 ms", low=0.001, high=10.0
    )
    ahead: float = param(0.005, "s", "time by which the stamp of a joint state may be ahead of the clock", low=0.0001, high=10.0)
    overspeed: float = param(
        1.2, "", "speed, in speed limits, with which two positions may differ; beyond it the joint state is refused", low=1.0, high=100.0
    )
    difference: float = param(
        0.010, "s", "time over which positions are differentiated where a driver sends no speeds", low=0.001, high=1.0
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


class JointStateCheck:
    """Check of the arm's joint states, which accepts or refuses them one by one.

    Attributes:
        params: Parameters of the check.
        last: The last accepted joint state; None before the first one.
        gap: Whether the last accepted joint state came more than the deadline after the one before it, by stamp or by arrival, or is the
            first one.
    """

    def __init__(self, model: ArmModel, params: JointStateParams | None = None) -> None:
        """Create the check of an arm, before any joint state; params None for the default."""
        self._model, self.params = model, params or JointStateParams()
        self.last: Joints | None = None
        self.gap = True
        self._arrived = self._heard = -math.inf  # s, monotonic, when `last` came, and when any joint state did
        self._periods: deque[float] = deque(maxlen=PERIOD_WINDOW)
        self._positions: deque[tuple[float, Array]] = deque(maxlen=1000)  # of the last `difference` s, without a gap

    @property
    def deadline(self) -> float:
        """Time (s) after the arrival of the last valid joint state at which the arm begins to brake.

        It depends on the measured period of the joint states.
        """
        period = statistics.median(self._periods) if self._periods else 0.0
        return max(self.params.silence, min(self.params.periods * period, LONGEST_DEADLINE))

    def silence(self, now: float) -> Failure | None:
        """Return a failure if at `now` (s, monotonic) the last valid joint state is older than the deadline; otherwise None."""
        age, bound = now - self._arrived, self.deadline
        return Failure(ArmStop.SILENT, age=age, bound=bound) if age > bound else None

    def accept(self, joints: Joints, now: float, clock: float | None = None, *, has_speeds: bool = True) -> Joints | Failure:
        """Check one joint state.

        Args:
            joints: Measured joint state.
            now: s, monotonic time at which it arrived.
            clock: s, reading at that time of the clock that makes the stamps; None if there is no such clock.
            has_speeds: False if the driver sends no speeds; they are then computed from the positions.

        Returns:
            The joint state to use, or a failure that tells why it is refused.
        """
        silent, self._heard = now - self._heard > self.deadline, now
        failure = self._impossible(joints) or self._untimely(joints, clock) or (None if silent else self._jumped(joints, now))
        if failure is not None:
            return failure
        last, deadline = self.last, self.deadline
        self.gap = last is None or now - self._arrived > deadline or not 0.0 < joints.time - last.time <= deadline
        if self.gap:
            self._positions.clear()
        else:
            self._periods.append(now - self._arrived)
        self._arrived = now
        if not has_speeds:
            joints = self._differentiated(joints)
        self.last = joints
        return joints

    def _impossible(self, joints: Joints) -> Failure | None:
        """Return why these numbers cannot be a state of this arm; None if they can."""
        (low, high), names, units = self._model.position_limits.T, self._model.names, self._model.limits.units
        beyond, shares = np.maximum(low - joints.q, joints.q - high), np.abs(joints.qdot) / self._model.speed_limits
        i, k = int(beyond.argmax()), int(shares.argmax())
        if beyond[i] > MOST_LIMIT_EXCESS:
            return Failure(ArmStop.NO_POSTURE, joint=names[i], unit=units[i], value=float(joints.q[i]), beyond=float(beyond[i]))
        if shares[k] > TIMES:
            return Failure(ArmStop.NO_SPEED, joint=names[k], unit=units[k], value=float(joints.qdot[k]), share=float(shares[k]))
        return None

    def _untimely(self, joints: Joints, clock: float | None) -> Failure | None:
        """Return why the stamp is refused: old, ahead of the clock, or not newer than the last one though the clock did not go back."""
        params, last = self.params, self.last
        if clock is not None and joints.time > clock + params.ahead:
            return Failure(ArmStop.AHEAD, age=joints.time - clock, bound=params.ahead)
        if clock is not None and joints.time < clock - params.late:
            return Failure(ArmStop.OLD, age=clock - joints.time, bound=params.late)
        clock_went_back = last is not None and clock is not None and last.time > clock + params.ahead
        if last is not None and joints.time <= last.time and not clock_went_back:
            return Failure(ArmStop.NOT_NEWER, stamp=joints.time, last=last.time)
        return None

    def _jumped(self, joints: Joints, now: float) -> Failure | None:
        """Return a failure if the positions differ from the last ones by more than the joints can have moved since; otherwise None."""
        last = self.last
        if last is None:
            return None
        passed = max(joints.time - last.time, now - self._arrived, 0.0)
        moved, possible = np.abs(joints.q - last.q), self.params.overspeed * self._model.speed_limits * passed + JUMP
        i = int((moved - possible).argmax())
        if moved[i] > possible[i]:
            name, unit = self._model.names[i], self._model.limits.units[i]
            return Failure(ArmStop.JUMP, joint=name, unit=unit, value=float(moved[i]), passed=passed, bound=float(possible[i]))
        return None

    def _differentiated(self, joints: Joints) -> Joints:
        """Return the joint state with speeds from the positions of the last `difference` seconds; zero while there are too few."""
        positions = self._positions
        positions.append((joints.time, joints.q))
        while len(positions) > 2 and joints.time - positions[1][0] >= self.params.difference:
            positions.popleft()
        time, q = positions[0]
        passed = joints.time - time
        qdot = (joints.q - q) / passed if passed >= self.params.difference else np.zeros(len(joints.q))
        return Joints(joints.time, joints.q, qdot)
