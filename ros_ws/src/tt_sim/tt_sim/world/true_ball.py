"""The true ball between table, net, floor and racket. The time of each contact is found exactly, with the racket in motion.

The ball rebounds about the line to the nearest point of the body that it touches. The integration takes steps in which the ball cannot
reach any body. Near a body it takes small steps, in which the root of the distance is found, or its minimum if the ball only grazes the
body.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from tt_core.arrays import VX, VY, VZ, Array, X, Y, Z
from tt_core.bounce import TableCoefficients, rebound_racket, rebound_table
from tt_core.constants import RACKET_RADIUS
from tt_core.errors import check_range
from tt_core.flight import MAX_STEP, AirCoefficients, ease, step
from tt_core.physics import Physics, PhysicsCoefficients, physics_coefficients
from tt_core.states import BallState

from .racket_motion import RacketInstant, RacketMotion, RacketTrack, fastest_point, racket_at
from .surfaces import BY_NUMBER, FLOOR, NET, NONE, RACKET, TABLE, BallShape, Gap, Surface, gap_to, racket_point_velocity
from .vectors import Vector, dot, norm, plus

NET_RESTITUTION = 0.1  # share of the speed towards the net that the ball keeps, an assumption: cord and cloth give little back
NET_DRAG = 0.1  # share of the speed along the net and of the spin that the ball loses, an assumption
LEAST_CONTACT = 1e-3  # m: a ball that is a point cannot touch a disc
SMALL_STEP = 1e-3  # s, near a body: a ball moves less than its radius
CONTACT_HALVINGS = 36  # number of times that SMALL_STEP is halved in the search for a contact, to 1.5e-14 s
LYING = 0.03  # m/s: a ball that meets the table more slowly does not bounce any more
MOST_CONTACTS_PER_CALL = 64  # in one call; a ball with as many is taken as lying

CONTACT_LOG = np.dtype(
    [
        ("surface", np.int64),  # TABLE, NET, FLOOR or RACKET of `surfaces`
        ("time", np.float64),  # s after the first instant of the racket
        ("before", np.float64, (9,)),  # state of the ball: position, velocity, spin
        ("after", np.float64, (9,)),
        ("offset", np.float64),  # m, from the centre of the racket's face to the point of contact
        ("edge", np.bool_),  # whether it was the rim of the racket or an edge of table or net
    ]
)


class Coefficients(NamedTuple):
    """Coefficients of the true world in the form in which Python passes them to compiled functions."""

    physics: Array  # (19,), `Physics.coefficients`
    racket_radius: float  # m

    @classmethod
    def of(cls, physics: Physics, racket_radius: float = RACKET_RADIUS) -> Coefficients:
        """Return the coefficients of a physics.

        Args:
            physics: Models of air, table and racket.
            racket_radius: m.
        """
        return cls(physics.coefficients, racket_radius)


class _Scene(NamedTuple):
    """What surrounds the ball."""

    air: AirCoefficients
    racket: RacketTrack
    shape: BallShape


class _Scratch(NamedTuple):
    """Arrays that kernels fill."""

    trial: Array  # (9,), work space: the ball at the times that the search for a contact tries
    work: Array  # (8, 3), of the integrator


class _Approach(NamedTuple):
    """Distance of ball and body at a trial time, and its rate of change.

    Attributes:
        gap: Distance between them.
        rate: m/s, at which the distance grows.
        racket: The racket at this time, if it is the body.
        arm: m, from the centre of its face to its point nearest to the ball.
    """

    gap: Gap
    rate: float
    racket: RacketInstant
    arm: Vector


_ORIGIN = Vector(0.0, 0.0, 0.0)
_NOWHERE = RacketInstant(_ORIGIN, _ORIGIN, _ORIGIN, _ORIGIN)


@dataclass(frozen=True, slots=True, eq=False)
class Contact:
    """One contact of the ball with a body.

    Attributes:
        surface: The body.
        before: The ball just before the contact.
        after: The ball just after the contact, at the same time.
        offset: m, from the centre of the racket's face to the point of contact; 0 for other bodies.
        edge: Whether the ball touched the rim of the racket, or an edge of table or net.
    """

    surface: Surface
    before: BallState
    after: BallState
    offset: float = 0.0
    edge: bool = False


@njit(cache=True)
def _approach(surface: int, ball: Array, duration: float, now: float, scene: _Scene, scratch: _Scratch) -> _Approach:
    """Return ball and body `duration` s after `ball` (9,), which is at `now` s of the racket's track.

    The ball at that time is left in `scratch.trial`.
    """
    trial = scratch.trial
    if duration > 0.0:
        step(ball, duration, scene.air, trial, scratch.work)
    else:
        trial[:] = ball
    racket = racket_at(scene.racket, now + duration) if surface == RACKET else _NOWHERE
    place, velocity = Vector(trial[X], trial[Y], trial[Z]), Vector(trial[VX], trial[VY], trial[VZ])
    gap = gap_to(surface, place, racket, scene.shape)
    rate, arm = dot(velocity, gap.normal), _ORIGIN
    if surface == RACKET:
        arm = plus(plus(place, -(gap.distance + scene.shape.contact_height), gap.normal), -1.0, racket.position)
        rate -= dot(racket_point_velocity(arm, racket), gap.normal)
    return _Approach(gap, rate, racket, arm)


@njit(cache=True)
def _time_to_contact(surface: int, ball: Array, h: float, now: float, scene: _Scene, scratch: _Scratch) -> float:
    """Return the time (s) to the contact within h s, a small step; inf without one. Arguments as of `_approach`."""
    begin = _approach(surface, ball, 0.0, now, scene, scratch)
    rate = begin.rate
    if begin.gap.distance <= 0.0 and rate <= 0.0:
        return 0.0
    end = _approach(surface, ball, h, now, scene, scratch)
    end_gap, end_rate = end.gap.distance, end.rate
    low, high = 0.0, h
    if (rate > 0.0 and end_gap <= 0.0) or (rate <= 0.0 and end_gap > 0.0 and end_rate > 0.0):  # by way of the furthest or the nearest point
        a, b = 0.0, h
        for _ in range(CONTACT_HALVINGS):
            middle = 0.5 * (a + b)
            grows = _approach(surface, ball, middle, now, scene, scratch).rate > 0.0
            if grows == (rate > 0.0):
                a = middle
            else:
                b = middle
        if rate > 0.0:
            low = b
        else:
            high = b
            if _approach(surface, ball, high, now, scene, scratch).gap.distance > 0.0:
                return np.inf
    elif end_gap > 0.0:
        return np.inf
    for _ in range(CONTACT_HALVINGS):
        middle = 0.5 * (low + high)
        if _approach(surface, ball, middle, now, scene, scratch).gap.distance <= 0.0:
            high = middle
        else:
            low = middle
    return high


@njit(cache=True)
def _rebound_edge(v: Array, w: Array, normal: Array, table: TableCoefficients) -> None:
    """Apply the table's rebound about another normal (3,), in place."""
    side = np.array([normal[2], normal[0], normal[1]])
    x = side - (side @ normal) * normal
    x /= math.sqrt(x @ x)
    y = np.array([normal[1] * x[2] - normal[2] * x[1], normal[2] * x[0] - normal[0] * x[2], normal[0] * x[1] - normal[1] * x[0]])
    lv, lw = np.array([v @ x, v @ y, v @ normal]), np.array([w @ x, w @ y, w @ normal])
    rebound_table(lv, lw, table)
    v[:] = lv[0] * x + lv[1] * y + lv[2] * normal
    w[:] = lw[0] * x + lw[1] * y + lw[2] * normal


@njit(cache=True)
def _rebound_net(v: Array, w: Array, normal: Array, rate: float) -> None:
    """Take most of the speed (rate, m/s, negative) towards the net, and a share of the rest and of the spin, in place."""
    for k in range(3):
        v[k] -= (1.0 + NET_RESTITUTION) * rate * normal[k] + NET_DRAG * (v[k] - rate * normal[k])
        w[k] *= 1.0 - NET_DRAG


@njit(cache=True)
def _rebound(surface: int, ball: Array, approach: _Approach, physics: PhysicsCoefficients) -> tuple[float, bool]:
    """Change the ball (9,), in place, as the surface does at the contact; return `offset` and `edge` of CONTACT_LOG."""
    v, w, n = ball[3:6], ball[6:9], approach.gap.normal
    normal = np.array([n.x, n.y, n.z])
    if surface == TABLE:
        if n.z > 1.0 - 1e-12:
            rebound_table(v, w, physics.table)
            return 0.0, False
        _rebound_edge(v, w, normal, physics.table)
        return 0.0, True
    if surface == NET:
        _rebound_net(v, w, normal, approach.rate)
        return 0.0, abs(n.z) > 1e-12
    if surface == RACKET:
        point = racket_point_velocity(approach.arm, approach.racket)
        rebound_racket(v, w, np.array([point.x, point.y, point.z]), normal, physics.racket)
        return norm(approach.arm), abs(dot(n, approach.racket.normal)) < 1.0 - 1e-9
    return 0.0, False


@njit(cache=True)
def travel(
    ball: Array, now: float, until: float, rackets: Array, tick: float, models: Coefficients, log: np.ndarray
) -> tuple[int, float, bool]:
    """Let a ball fly and rebound for some time.

    Times are in s after the first state of the racket.

    Args:
        ball: (9,) position (m), velocity (m/s), spin (rad/s) at `now`; changed in place.
        now: s, time at which the flight begins.
        until: s, time at which it ends if nothing else ends it.
        rackets: (n, 12) RacketMotion.row at times `tick` apart.
        tick: s.
        models: Coefficients of the true world.
        log: (m,) of CONTACT_LOG, filled with the contacts. A ball with m contacts is taken as lying.

    Returns:
        The number of contacts, the time (s) when the flight ended, and whether the ball is still in play, i.e. neither on the floor nor
        lying.
    """
    physics = physics_coefficients(models.physics)
    scene = _Scene(physics.air, RacketTrack(rackets, tick), BallShape(physics.contact_height, models.racket_radius))
    scratch = _Scratch(np.empty(9), np.empty((8, 3)))
    soonest = np.empty(5)  # s, in which each surface can be reached at the earliest
    fastest = 1.0 + fastest_point(scene.racket, models.racket_radius)
    n = 0
    while until - now > 1e-12:
        speed = 1.0 + math.sqrt(ball[VX] ** 2 + ball[VY] ** 2 + ball[VZ] ** 2)
        racket, place = racket_at(scene.racket, now), Vector(ball[X], ball[Y], ball[Z])
        for surface in range(1, 5):
            soonest[surface] = gap_to(surface, place, racket, scene.shape).distance / (speed + (fastest if surface == RACKET else 0.0))
        safe = min(MAX_STEP * ease(ball, physics.air), soonest[1:].min())
        if safe > SMALL_STEP:
            h = min(safe, until - now)
            step(ball, h, physics.air, ball, scratch.work)
            now += h
            continue
        h, met, first = min(SMALL_STEP, until - now), NONE, np.inf
        for surface in range(1, 5):
            if soonest[surface] > h:
                continue
            at = _time_to_contact(surface, ball, h, now, scene, scratch)
            if at < first:
                met, first = surface, at
        if met == NONE:
            step(ball, h, physics.air, ball, scratch.work)
            now += h
            continue
        approach = _approach(met, ball, first, now, scene, scratch)
        ball[:] = scratch.trial
        now += first
        contact = log[n]
        contact.surface, contact.time = met, now
        contact.before[:] = ball
        contact.offset, contact.edge = _rebound(met, ball, approach, physics)
        contact.after[:] = ball
        n += 1
        lies = met == FLOOR or (met == TABLE and -approach.rate < LYING)
        if lies or n == len(log):
            return n, now, False
    return n, now, True


def contacts_from(log: np.ndarray, start: float) -> list[Contact]:
    """Return the contacts in a log that `travel` has filled.

    Args:
        log: (n,) of CONTACT_LOG.
        start: s, time of the first state of the racket.
    """
    rows = log.copy()
    rows.flags.writeable = False
    surfaces, times, offsets, edges = (rows[name].tolist() for name in ("surface", "time", "offset", "edge"))
    before, after = rows["before"], rows["after"]
    return [
        Contact(BY_NUMBER[surfaces[k]], _ball(start + times[k], before[k]), _ball(start + times[k], after[k]), offsets[k], edges[k])
        for k in range(len(rows))
    ]


def _ball(time: float, row: Array) -> BallState:
    """Return the ball of a read-only state (9,)."""
    return BallState.trusted(time, row[:3], row[3:6], row[6:])


class World:
    """The true world of one ball. Only the simulator may use it, because nodes must not know the truth.

    Attributes:
        ball: The ball now; None if there is none, or if it lies on the floor or the table.
    """

    def __init__(self, physics: Physics, racket_radius: float = RACKET_RADIUS) -> None:
        """Start without a ball.

        Args:
            physics: True physics of the ball.
            racket_radius: m.

        Raises:
            OutOfRange: The contact height is outside LEAST_CONTACT to 0.1 m.
        """
        check_range("contact_height of the true world", physics.contact_height, LEAST_CONTACT, 0.1)
        self.ball: BallState | None = None
        self._models = Coefficients.of(physics, racket_radius)
        self._log = np.empty(MOST_CONTACTS_PER_CALL, dtype=CONTACT_LOG)

    def advance(self, until: float, rackets: Sequence[RacketMotion] | Array, tick: float) -> list[Contact]:
        """Let the ball fly until a given time. A ball that comes to lie is removed.

        Args:
            until: s.
            rackets: States of the racket every `tick` s, the last one at `until`; or their rows as an array (n, 12), see RacketMotion.row.
            tick: s.

        Returns:
            The contacts on the way.
        """
        if self.ball is None or until - self.ball.time <= 1e-12:
            return []
        rows = rackets if isinstance(rackets, np.ndarray) else np.array([racket.row for racket in rackets])
        start = until - tick * (len(rows) - 1)
        state = self.ball.vector
        n, now, is_in_play = travel(state, self.ball.time - start, until - start, rows, tick, self._models, self._log)
        state.flags.writeable = False
        self.ball = _ball(start + now, state) if is_in_play else None
        return contacts_from(self._log[:n], start) if n else []
