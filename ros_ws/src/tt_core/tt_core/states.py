"""What flows through the robot. SI units, frame `table`; arrays are float64, copied in, read-only."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit

from .errors import BadShape, TtError, check_array, check_range

Array = npt.NDArray[np.float64]


_set = object.__setattr__  # of frozen dataclasses


def _freeze(state: object, **shapes: tuple[int, ...]) -> None:
    for name, shape in shapes.items():
        _set(state, name, check_array(name, getattr(state, name), shape))


@dataclass(frozen=True, slots=True, eq=False)
class BallState:
    """The ball at one instant.

    time: s. position: (3,) m, its centre. velocity: (3,) m/s. spin: (3,) rad/s, topspin of a ball flying to -x is w_y < 0.
    covariance: (9, 9) of position, velocity, spin in that order, or None when not known.
    """

    time: float
    position: Array
    velocity: Array
    spin: Array
    covariance: Array | None = None

    def __post_init__(self) -> None:
        _set(self, "time", check_range("time", self.time, -math.inf, math.inf))
        _freeze(self, position=(3,), velocity=(3,), spin=(3,))
        if self.covariance is not None:
            _freeze(self, covariance=(9, 9))

    @property
    def vector(self) -> Array:
        """(9,) position, velocity, spin."""
        return np.concatenate([self.position, self.velocity, self.spin])

    @classmethod
    def from_vector(cls, time: float, vector: Array, covariance: Array | None = None) -> BallState:
        """vector: (9,) position, velocity, spin."""
        return cls(time, vector[:3], vector[3:6], vector[6:9], covariance)

    @classmethod
    def trusted(cls, time: float, position: Array, velocity: Array, spin: Array) -> BallState:
        """From read-only (3,) arrays that have been checked, or that a kernel here has just made: neither copied nor checked."""
        ball = cls.__new__(cls)
        _set(ball, "time", time)
        _set(ball, "position", position)
        _set(ball, "velocity", velocity)
        _set(ball, "spin", spin)
        _set(ball, "covariance", None)
        return ball


@dataclass(frozen=True, slots=True, eq=False)
class Bounce:
    """A contact with the table: where, when, and the ball just before and just after it."""

    before: BallState
    after: BallState

    @property
    def time(self) -> float:
        return self.after.time

    @property
    def position(self) -> Array:
        """(3,) m, centre of the ball."""
        return self.after.position


@dataclass(frozen=True, slots=True, eq=False)
class BallPath:
    """The ball over time, dense enough for cubic interpolation (< 1e-7 m between points 20 ms apart).

    times: (n,) s, not decreasing; a bounce is two points of one time, before and after.
    positions, velocities, spins: (n, 3). bounces: those on the way. ended: why the path stops where it does.
    """

    times: Array
    positions: Array
    velocities: Array
    spins: Array
    bounces: tuple[Bounce, ...] = ()
    ended: str = "stop"

    def __post_init__(self) -> None:
        _freeze(self, times=(-1,), positions=(-1, 3), velocities=(-1, 3), spins=(-1, 3))
        for name in ("positions", "velocities", "spins"):
            if len(getattr(self, name)) != len(self.times):
                raise BadShape(name, getattr(self, name).shape, (len(self.times), 3))
        if len(self.times) == 0 or (np.diff(self.times) < 0.0).any():
            raise TtError("times of a path must not be empty and must not decrease")

    @classmethod
    def trusted(cls, rows: Array, bounces: tuple[Bounce, ...], ended: str) -> BallPath:
        """From rows (n, 10) of time, position, velocity, spin that a kernel here has just made: neither copied nor checked."""
        path = cls.__new__(cls)
        _set(path, "times", rows[:, 0])
        _set(path, "positions", rows[:, 1:4])
        _set(path, "velocities", rows[:, 4:7])
        _set(path, "spins", rows[:, 7:10])
        _set(path, "bounces", bounces)
        _set(path, "ended", ended)
        return path

    @property
    def end(self) -> BallState:
        return BallState.trusted(float(self.times[-1]), self.positions[-1], self.velocities[-1], self.spins[-1])

    def at(self, time: float) -> BallState:
        """The ball at `time`, after the bounce when a bounce is at `time`; raises OutOfRange outside the path."""
        row = self.rows(np.array([check_range("time", time, self.times[0], self.times[-1])]))[0]
        return BallState.trusted(float(time), row[:3], row[3:6], row[6:])

    def rows(self, times: Array) -> Array:
        """(n, 9) position, velocity, spin at times (n,) s on the path, after the bounce when a bounce is at one of them; read-only."""
        out = _between(np.array(self.times), np.array(self.positions), np.array(self.velocities), np.array(self.spins), np.array(times))
        out.flags.writeable = False
        return out


@njit(cache=True)
def _between(times: Array, positions: Array, velocities: Array, spins: Array, at: Array) -> Array:
    """(m, 9) at times `at` (m,) of n points; cubic in position, its derivative in velocity, linear in spin."""
    out, last = np.empty((len(at), 9)), len(times) - 1
    for k in range(len(at)):
        i = min(np.searchsorted(times, at[k], side="right"), last)
        b = max(i - 1, 0)
        h = times[i] - times[b]
        h, s = (h, (at[k] - times[b]) / h) if h > 0.0 else (1.0, 1.0)
        u = 1.0 - s
        for j in range(3):
            way, v0, v1 = positions[i, j] - positions[b, j], velocities[b, j], velocities[i, j]
            out[k, j] = positions[b, j] + s * s * (3.0 - 2.0 * s) * way + h * s * u * (u * v0 - s * v1)
            out[k, 3 + j] = 6.0 * s * u / h * way + u * (1.0 - 3.0 * s) * v0 + s * (3.0 * s - 2.0) * v1
            out[k, 6 + j] = u * spins[b, j] + s * spins[i, j]
    return out


@dataclass(frozen=True, slots=True, eq=False)
class ReturnGoal:
    """What the returned ball is asked to do.

    landing: (2,) m, x and y of the centre at the first contact with the table. flight_time: s, from racket to landing.
    spin_y, spin_z: rad/s after the hit; spin_x follows from them (dissertation (4.16)).
    """

    landing: Array
    flight_time: float
    spin_y: float
    spin_z: float

    def __post_init__(self) -> None:
        _freeze(self, landing=(2,))
        _set(self, "flight_time", check_range("flight_time", self.flight_time, 0.01, 5.0))
        for name in ("spin_y", "spin_z"):
            _set(self, name, check_range(name, getattr(self, name), -2000.0, 2000.0))


@dataclass(frozen=True, slots=True, eq=False)
class RacketState:
    """The racket at the strike.

    time: s. position: (3,) m, centre of the face. velocity: (3,) m/s. alpha, beta: rad, the face normal points to the ball;
    rotation_racket_to_table = Ry(beta) Rx(alpha) (dissertation Section 3.4, the direction corrected).
    """

    time: float
    position: Array
    velocity: Array
    alpha: float
    beta: float

    def __post_init__(self) -> None:
        _freeze(self, position=(3,), velocity=(3,))
        for name in ("time", "alpha", "beta"):
            _set(self, name, check_range(name, getattr(self, name), -math.inf, math.inf))

    @classmethod
    def trusted(cls, time: float, position: Array, velocity: Array, alpha: float, beta: float) -> RacketState:
        """From read-only (3,) arrays that a kernel here has just made: neither copied nor checked."""
        racket = cls.__new__(cls)
        _set(racket, "time", time)
        _set(racket, "position", position)
        _set(racket, "velocity", velocity)
        _set(racket, "alpha", alpha)
        _set(racket, "beta", beta)
        return racket

    @classmethod
    def facing(cls, time: float, position: Array, velocity: Array, normal: Array) -> RacketState:
        """From the unit face normal (3,): alpha = -asin(n_y), beta = atan2(n_x, n_z)."""
        alpha = -math.asin(min(1.0, max(-1.0, float(normal[1]))))
        return cls(time, position, velocity, alpha, math.atan2(float(normal[0]), float(normal[2])))

    @property
    def normal(self) -> Array:
        """(3,) unit, z axis of the racket in `table`."""
        c = math.cos(self.alpha)
        return np.array([c * math.sin(self.beta), -math.sin(self.alpha), c * math.cos(self.beta)])

    @property
    def rotation(self) -> Array:
        """(3, 3) racket to table, as printed in Section 3.4."""
        sa, ca, sb, cb = math.sin(self.alpha), math.cos(self.alpha), math.sin(self.beta), math.cos(self.beta)
        return np.array([[cb, sb * sa, sb * ca], [0.0, ca, -sa], [-sb, cb * sa, cb * ca]])
