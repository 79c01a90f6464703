"""The racket of the true world: at one instant, and over time as the ball's kernels need it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.interpolate import hermite
from tt_core.states import Array


@dataclass(frozen=True, slots=True, eq=False)
class RacketMotion:
    """The racket at one instant, in frame `table`.

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
        """Unit normal of the face, (3,)."""
        return self.rotation[:, 2]

    @property
    def row(self) -> Array:
        """Position, normal, velocity and angular velocity, (12,), of which `racket_track` is made."""
        return np.concatenate([self.position, self.normal, self.velocity, self.turning])


class RacketTrack(NamedTuple):
    """The racket at instants `tick` apart, for the kernels; fields as those of RacketMotion, (n, 3) each."""

    position: Array
    normal: Array
    velocity: Array
    turning: Array
    tick: float  # s


class RacketInstant(NamedTuple):
    """The racket at one instant, for the kernels, which fill its arrays; fields as those of RacketMotion, (3,) each."""

    position: Array
    normal: Array
    velocity: Array
    turning: Array


@njit(cache=True)
def racket_track(rows: Array, tick: float) -> RacketTrack:
    """Give names to the columns of rows (n, 12) of RacketMotion.row, `tick` s apart. The fields are views: writing them writes the rows."""
    return RacketTrack(rows[:, 0:3], rows[:, 3:6], rows[:, 6:9], rows[:, 9:12], tick)


@njit(cache=True)
def racket_at(track: RacketTrack, time: float, out: RacketInstant) -> None:
    """Interpolate the racket: Hermite in position, linear in the rest; before and after the track it is as at its ends.

    Args:
        track: The racket.
        time: s after its first instant.
        out: Is filled.
    """
    last = len(track.position) - 1
    i = min(max(0, int(time / track.tick)), max(0, last - 1))
    j = min(i + 1, last)
    u = min(1.0, max(0.0, time / track.tick - i))
    for k in range(3):
        out.position[k] = hermite(track.position[i, k], track.velocity[i, k], track.position[j, k], track.velocity[j, k], track.tick, u)
        out.normal[k] = (1.0 - u) * track.normal[i, k] + u * track.normal[j, k]
        out.velocity[k] = (1.0 - u) * track.velocity[i, k] + u * track.velocity[j, k]
        out.turning[k] = (1.0 - u) * track.turning[i, k] + u * track.turning[j, k]
    norm = math.sqrt(out.normal[0] ** 2 + out.normal[1] ** 2 + out.normal[2] ** 2)
    for k in range(3):
        out.normal[k] /= norm


@njit(cache=True)
def fastest_point(track: RacketTrack, radius: float) -> float:
    """Return a bound of the speed (m/s) of every point of a racket of that radius (m)."""
    fastest = 0.0
    for i in range(len(track.position)):
        v, w = track.velocity[i], track.turning[i]
        speed = math.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2) + radius * math.sqrt(w[0] ** 2 + w[1] ** 2 + w[2] ** 2)
        fastest = max(fastest, speed)
    return fastest
