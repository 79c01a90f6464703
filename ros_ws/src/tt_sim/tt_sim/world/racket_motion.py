"""True state of the racket: at one time, and as a function of time for the compiled functions of the ball."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.interpolate import hermite
from tt_core.states import Array

from .vectors import Vector, norm


@dataclass(frozen=True, slots=True, eq=False)
class RacketMotion:
    """State of the racket at one time, in frame `table`.

    Attributes:
        position: (3,) m, centre of the face.
        rotation: (3, 3) from the frame of the racket to `table`.
        velocity: (3,) m/s, of the centre.
        turning: (3,) rad/s, angular velocity.
    """

    position: Array
    rotation: Array
    velocity: Array
    turning: Array

    @property
    def normal(self) -> Array:
        """Unit normal of the face, (3,) in `table`."""
        return self.rotation[:, 2]

    @property
    def row(self) -> Array:
        """Position (m), normal, velocity (m/s) and angular velocity (rad/s) as one array (12,), the form that compiled functions take."""
        return np.concatenate([self.position, self.normal, self.velocity, self.turning])


class RacketTrack(NamedTuple):
    """States of the racket at equally spaced times, for compiled functions.

    Attributes:
        rows: (n, 12) RacketMotion.row at each time.
        tick: s, between two rows.
    """

    rows: Array
    tick: float


class RacketInstant(NamedTuple):
    """State of the racket at one time for compiled functions, with the fields of RacketMotion."""

    position: Vector
    normal: Vector
    velocity: Vector
    turning: Vector


@njit(cache=True)
def racket_instant(row: Array) -> RacketInstant:
    """Give names to the numbers of RacketMotion.row, (12,)."""
    return RacketInstant(
        Vector(row[0], row[1], row[2]), Vector(row[3], row[4], row[5]), Vector(row[6], row[7], row[8]), Vector(row[9], row[10], row[11])
    )


@njit(cache=True)
def racket_at(track: RacketTrack, time: float) -> RacketInstant:
    """Interpolate the state of the racket in time: cubic Hermite in position, linear in the rest.

    Before and after the track the racket is as at its ends.

    Args:
        track: States of the racket.
        time: s after the first state.
    """
    last, tick = len(track.rows) - 1, track.tick
    i = min(max(0, int(time / tick)), max(0, last - 1))
    start, end = racket_instant(track.rows[i]), racket_instant(track.rows[min(i + 1, last)])
    share = min(1.0, max(0.0, time / tick - i))
    p, q, v, w = start.position, end.position, start.velocity, end.velocity
    normal = _between(start.normal, end.normal, share)
    length = norm(normal)
    return RacketInstant(
        Vector(
            hermite(p.x, v.x, q.x, w.x, tick, share), hermite(p.y, v.y, q.y, w.y, tick, share), hermite(p.z, v.z, q.z, w.z, tick, share)
        ),
        Vector(normal.x / length, normal.y / length, normal.z / length),
        _between(v, w, share),
        _between(start.turning, end.turning, share),
    )


@njit(cache=True)
def _between(start: Vector, end: Vector, share: float) -> Vector:
    rest = 1.0 - share
    return Vector(rest * start.x + share * end.x, rest * start.y + share * end.y, rest * start.z + share * end.z)


@njit(cache=True)
def fastest_point(track: RacketTrack, radius: float) -> float:
    """Return an upper bound of the speed (m/s) of all points of the racket, at the times of the track.

    Args:
        track: States of the racket.
        radius: m, radius of the racket.
    """
    fastest = 0.0
    for i in range(len(track.rows)):
        racket = racket_instant(track.rows[i])
        fastest = max(fastest, norm(racket.velocity) + radius * norm(racket.turning))
    return fastest
