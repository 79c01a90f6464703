"""States of ball and racket, paths and goals. SI units, frame `table`; arrays are float64, copied in, read-only."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from .arrays import POSITION, SPIN, TIME, VELOCITY, Array
from .errors import BadShape, TtError, ValueFailure, check_array, check_range
from .interpolate import interpolate_states
from .path_end import PathEnd

UNKNOWN_VARIANCE = 1e6  # variance of each component of a position, velocity or spin that is not known, in its unit squared

_set = object.__setattr__  # of frozen dataclasses
_ROW_POSITION, _ROW_VELOCITY, _ROW_SPIN = slice(1, 4), slice(4, 7), slice(7, 10)  # columns of a path (n, 10); column 0 is the time


def _freeze(state: object, **shapes: tuple[int, ...]) -> None:
    """Replace each array by a checked, read-only copy."""
    for name, shape in shapes.items():
        _set(state, name, check_array(name, getattr(state, name), shape))


@dataclass(frozen=True, slots=True, eq=False)
class BallState:
    """The ball at one instant, in frame `table`.

    Attributes:
        time: s.
        position: (3,) m, its centre.
        velocity: (3,) m/s.
        spin: (3,) rad/s. Topspin of a ball that flies to -x is w_y < 0.
        covariance: (9, 9) of position, velocity, spin in that order, or None if unknown.

    Raises:
        BadShape: An array has another shape.
        NotFinite: A number is NaN or infinite.
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
        """Position (m), velocity (m/s) and spin (rad/s) as one array (9,)."""
        return np.concatenate([self.position, self.velocity, self.spin])

    @classmethod
    def from_vector(cls, time: float, vector: Array, covariance: Array | None = None) -> BallState:
        """Return the state whose numbers are in one array.

        Args:
            time: s.
            vector: (9,) position (m), velocity (m/s), spin (rad/s).
            covariance: (9, 9) of `vector`, or None if unknown.
        """
        return cls(time, vector[POSITION], vector[VELOCITY], vector[SPIN], covariance)

    @classmethod
    def trusted(cls, time: float, position: Array, velocity: Array, spin: Array) -> BallState:
        """Return a state without copying or checking its arrays, which must be valid and read-only.

        Args:
            time: s.
            position: (3,) m.
            velocity: (3,) m/s.
            spin: (3,) rad/s.
        """
        ball = cls.__new__(cls)
        _set(ball, "time", time)
        _set(ball, "position", position)
        _set(ball, "velocity", velocity)
        _set(ball, "spin", spin)
        _set(ball, "covariance", None)
        return ball


@dataclass(frozen=True, slots=True, eq=False)
class Bounce:
    """One contact of the ball with the table.

    Attributes:
        before: The ball just before the contact.
        after: The ball just after the contact, at the same time and place.
    """

    before: BallState
    after: BallState

    @property
    def time(self) -> float:
        """Time of the contact, s."""
        return self.after.time

    @property
    def position(self) -> Array:
        """Centre of the ball at the contact, (3,) m in `table`."""
        return self.after.position


@dataclass(frozen=True, slots=True, eq=False)
class BallPath:
    """Flight of the ball over time, e.g. a predicted one: its states at successive times, in frame `table`.

    The states are dense enough for cubic interpolation: between points 20 ms apart it is less than 1e-7 m off.

    Attributes:
        times: (n,) s, not decreasing. A bounce is two points of the same time: the states before and after it.
        positions: (n, 3) m.
        velocities: (n, 3) m/s.
        spins: (n, 3) rad/s.
        bounces: The contacts with the table on the way.
        ended: Why the path stops where it does.

    Raises:
        BadShape: The arrays have other shapes or different lengths.
        NotFinite: A number is NaN or infinite.
        TtError: There is no point, or the times decrease.
    """

    times: Array
    positions: Array
    velocities: Array
    spins: Array
    bounces: tuple[Bounce, ...] = ()
    ended: PathEnd = PathEnd.STOP

    def __post_init__(self) -> None:
        _freeze(self, times=(-1,), positions=(-1, 3), velocities=(-1, 3), spins=(-1, 3))
        for name in ("positions", "velocities", "spins"):
            if len(getattr(self, name)) != len(self.times):
                raise BadShape(name, getattr(self, name).shape, (len(self.times), 3))
        if len(self.times) == 0 or (np.diff(self.times) < 0.0).any():
            raise TtError(ValueFailure.DECREASING, name="times of a path")

    @classmethod
    def trusted(cls, rows: Array, bounces: tuple[Bounce, ...], ended: PathEnd) -> BallPath:
        """Return a path without copying or checking its array, which must be valid and read-only.

        Args:
            rows: (n, 10) time (s), position (m), velocity (m/s) and spin (rad/s) of each point.
            bounces: The contacts with the table.
            ended: Why the path stops where it does.
        """
        path = cls.__new__(cls)
        _set(path, "times", rows[:, TIME])
        _set(path, "positions", rows[:, _ROW_POSITION])
        _set(path, "velocities", rows[:, _ROW_VELOCITY])
        _set(path, "spins", rows[:, _ROW_SPIN])
        _set(path, "bounces", bounces)
        _set(path, "ended", ended)
        return path

    @property
    def end(self) -> BallState:
        """The ball at the last point of the path."""
        return BallState.trusted(float(self.times[-1]), self.positions[-1], self.velocities[-1], self.spins[-1])

    def at(self, time: float) -> BallState:
        """Return the ball at `time` (s). At the time of a bounce this is the ball after the bounce.

        Raises:
            NotFinite: `time` is NaN or infinite.
            OutOfRange: `time` is not on the path.
        """
        row = self.rows(np.array([check_range("time", time, self.times[0], self.times[-1])]))[0]
        return BallState.trusted(float(time), row[POSITION], row[VELOCITY], row[SPIN])

    def rows(self, times: Array) -> Array:
        """Return the states of the ball at many times as one array.

        Args:
            times: (n,) s, all on the path; this is not checked.

        Returns:
            (n, 9) position (m), velocity (m/s) and spin (rad/s), read-only. At the time of a bounce this is the state after the bounce.
        """
        states = np.concatenate([self.positions, self.velocities, self.spins], axis=1)
        out: Array = interpolate_states(np.array(self.times), states, np.array(times))
        out.flags.writeable = False
        return out


@dataclass(frozen=True, slots=True, eq=False)
class ReturnGoal:
    """Goal of a return: where the returned ball is to land, how long it is to fly, and with which spin. Frame `table`.

    Attributes:
        landing: (2,) m, x and y of the ball's centre at its first contact with the table.
        flight_time: s, from racket to landing, 0.01 to 5.
        spin_y: rad/s after the hit, -2000 to 2000.
        spin_z: rad/s after the hit, -2000 to 2000. Spin x follows from the other two (dissertation (4.16)).
        vector: (5,) all of these in this order, as kernels take them; made from the others.

    Raises:
        BadShape: `landing` has another shape.
        NotFinite: A number is NaN or infinite.
        OutOfRange: A number is outside its range.
    """

    landing: Array
    flight_time: float
    spin_y: float
    spin_z: float
    vector: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        landing = check_array("landing", self.landing, (2,))
        self._fill(np.array([*landing.tolist(), self.flight_time, self.spin_y, self.spin_z], dtype=np.float64))

    def _fill(self, vector: Array) -> None:
        """Check the numbers of an array (5,) that no other object uses, and store them."""
        x, y, flight_time, spin_y, spin_z = vector.tolist()
        check_range("landing x", x, -math.inf, math.inf)
        check_range("landing y", y, -math.inf, math.inf)
        vector.flags.writeable = False
        _set(self, "landing", vector[:2])
        _set(self, "flight_time", check_range("flight_time", flight_time, 0.01, 5.0))
        _set(self, "spin_y", check_range("spin_y", spin_y, -2000.0, 2000.0))
        _set(self, "spin_z", check_range("spin_z", spin_z, -2000.0, 2000.0))
        _set(self, "vector", vector)

    @classmethod
    def from_vector(cls, vector: Array) -> ReturnGoal:
        """Return the goal whose numbers are in one array, as in the attribute `vector`.

        Args:
            vector: (5,) landing x (m), landing y (m), flight time (s), spin y (rad/s), spin z (rad/s).

        Raises:
            NotFinite: A number is NaN or infinite.
            OutOfRange: A number is outside its range.
        """
        goal = cls.__new__(cls)
        goal._fill(np.array(vector, dtype=np.float64))
        return goal


@dataclass(frozen=True, slots=True, eq=False)
class RacketState:
    """The racket at the instant at which it hits the ball, in frame `table`: a stroke.

    The orientation is rotation_racket_to_table = Ry(beta) Rx(alpha) (dissertation Section 3.4, the direction corrected).

    Attributes:
        time: s.
        position: (3,) m, centre of the face.
        velocity: (3,) m/s.
        alpha: rad, rotation about x. The face normal points to the ball.
        beta: rad, rotation about y.

    Raises:
        BadShape: An array has another shape.
        NotFinite: A number is NaN or infinite.
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
        """Return a state without copying or checking its arrays, which must be valid and read-only.

        Args:
            time: s.
            position: (3,) m, centre of the face.
            velocity: (3,) m/s.
            alpha: rad, rotation about x.
            beta: rad, rotation about y.
        """
        racket = cls.__new__(cls)
        _set(racket, "time", time)
        _set(racket, "position", position)
        _set(racket, "velocity", velocity)
        _set(racket, "alpha", alpha)
        _set(racket, "beta", beta)
        return racket

    @classmethod
    def facing(cls, time: float, position: Array, velocity: Array, normal: Array) -> RacketState:
        """Return the racket with a given face normal n: alpha = -asin(n_y), beta = atan2(n_x, n_z).

        Args:
            time: s.
            position: (3,) m in `table`, centre of the face.
            velocity: (3,) m/s in `table`.
            normal: (3,) unit face normal n in `table`.

        Raises:
            BadShape: An array has another shape.
            NotFinite: A number is NaN or infinite.
        """
        alpha, beta = cls.angles(normal)
        return cls(time, position, velocity, float(alpha), float(beta))

    @staticmethod
    def angles(normals: Array) -> tuple[Array, Array]:
        """Return the angles alpha and beta (...,) in rad of rackets with given face normals.

        Args:
            normals: (..., 3) unit face normals in `table`.
        """
        normals = np.asarray(normals)
        return -np.arcsin(np.clip(normals[..., 1], -1.0, 1.0)), np.arctan2(normals[..., 0], normals[..., 2])

    @property
    def normal(self) -> Array:
        """Unit face normal (3,) in `table`, the z axis of the racket."""
        c = math.cos(self.alpha)
        return np.array([c * math.sin(self.beta), -math.sin(self.alpha), c * math.cos(self.beta)])

    @property
    def rotation(self) -> Array:
        """Rotation matrix (3, 3) from the racket's frame to `table`, as printed in Section 3.4 of the dissertation."""
        sa, ca, sb, cb = math.sin(self.alpha), math.cos(self.alpha), math.sin(self.beta), math.cos(self.beta)
        return np.array([[cb, sb * sa, sb * ca], [0.0, ca, -sa], [-sb, cb * sa, cb * ca]])
