"""Which joint states are used: one that is broken, old, repeated or impossible is refused before anything is computed from it.

All ages are checked twice: by stamp against the clock, and by arrival on a monotonic clock. The deadline for silence runs on arrival only.
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

BEYOND = 1.0  # rad or m beyond a position limit, above which a number is no position of this joint; the mechanical stops are nearer
TIMES = 10.0  # speed limits, above which a number is no speed of this joint
JUMP = 0.02  # rad or m, by which noise may make two positions differ beyond what the speed limits allow
LONGEST_DEADLINE = 0.3  # s, whatever the period of the joint states
WINDOW = 15  # joint states whose median distance is their period


@dataclass(frozen=True, slots=True)
class JointStateParams:
    """When joint states are used."""

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
    """Accept or refuse joint states one by one.

    Attributes:
        params: What is accepted.
        last: The newest joint state that was accepted, None before the first.
        gap: Whether the last accepted one came later after its predecessor than the deadline, by stamp or by arrival.
    """

    def __init__(self, model: ArmModel, params: JointStateParams | None = None) -> None:
        """Begin without any joint state."""
        self._model, self.params = model, params or JointStateParams()
        self.last: Joints | None = None
        self.gap = True
        self._arrived = self._heard = -math.inf  # s, monotonic, when `last` came, and when any joint state did
        self._periods: deque[float] = deque(maxlen=WINDOW)
        self._positions: deque[tuple[float, Array]] = deque(maxlen=1000)  # of the last `difference` s, without a gap

    @property
    def deadline(self) -> float:
        """Return how long (s) after the last valid joint state the arm begins to brake."""
        period = statistics.median(self._periods) if self._periods else 0.0
        return max(self.params.silence, min(self.params.periods * period, LONGEST_DEADLINE))

    def silence(self, now: float) -> Failure | None:
        """Return the failure when at `now` (s, monotonic) the last valid joint state came too long ago."""
        age, bound = now - self._arrived, self.deadline
        return Failure(ArmStop.SILENT, age=age, bound=bound) if age > bound else None

    def accept(self, joints: Joints, now: float, clock: float | None = None, *, has_speeds: bool = True) -> Joints | Failure:
        """Return the joint state to be used, or why this one is not.

        Args:
            joints: As measured.
            now: s, monotonic, when it came.
            clock: s, what the clock of the stamps showed then; None where there is no such clock.
            has_speeds: False where the driver sends no speeds. They are then differences of positions.
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
        """Return why no intact sensor of this arm can have measured this, or None."""
        (low, high), names, units = self._model.position_limits.T, self._model.names, self._model.limits.units
        beyond, shares = np.maximum(low - joints.q, joints.q - high), np.abs(joints.qdot) / self._model.speed_limits
        i, k = int(beyond.argmax()), int(shares.argmax())
        if beyond[i] > BEYOND:
            return Failure(ArmStop.NO_POSTURE, joint=names[i], unit=units[i], value=float(joints.q[i]), beyond=float(beyond[i]))
        if shares[k] > TIMES:
            return Failure(ArmStop.NO_SPEED, joint=names[k], unit=units[k], value=float(joints.qdot[k]), share=float(shares[k]))
        return None

    def _untimely(self, joints: Joints, clock: float | None) -> Failure | None:
        """Return whether it is old, ahead, or not newer than the last one, unless the clock itself went back since."""
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
        """Return whether it is further from the last one than the joints can have moved since. It is not called after silence."""
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
        """Return the same with speeds from the positions of the last `difference` s; zero until there are positions for so long."""
        positions = self._positions
        positions.append((joints.time, joints.q))
        while len(positions) > 2 and joints.time - positions[1][0] >= self.params.difference:
            positions.popleft()
        time, q = positions[0]
        passed = joints.time - time
        qdot = (joints.q - q) / passed if passed >= self.params.difference else np.zeros(len(joints.q))
        return Joints(joints.time, joints.q, qdot)
