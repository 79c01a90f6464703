"""The true ball between table, net, floor and racket. Contacts are found at their instant; the racket moves between two of its states.

Table and net are boxes and the racket is a disc, so face, edge, corner and rim are one rule: the ball touches where the distance from its
centre to the body falls to its radius, and rebounds about the line to the nearest point. The walk takes steps that cannot reach anything,
and near a body small ones, in which the distance is searched for its root, or for its valley when the ball only grazes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from tt_core.bounce import rebound_racket, rebound_table
from tt_core.constants import (
    BALL_RADIUS,
    FLOOR_Z,
    NET_HEIGHT,
    NET_OVERHANG,
    NET_X,
    RACKET_RADIUS,
    TABLE_LENGTH,
    TABLE_THICKNESS,
    TABLE_WIDTH,
)
from tt_core.errors import check_range
from tt_core.flight import MAX_STEP, ease, step
from tt_core.physics import Physics
from tt_core.states import Array, BallState

NET_THICKNESS = 0.002  # m
NET_RESTITUTION = 0.1  # of the speed towards the net, an assumption: cord and cloth give little back
NET_DRAG = 0.1  # share of the speed along the net and of the spin that it takes, an assumption
LEAST_CONTACT = 1e-3  # m: a ball that is a point cannot touch a disc
SMALL_STEP = 1e-3  # s, near a body: a ball moves less than its radius
HALVINGS = 36  # of SMALL_STEP, to 1.5e-14 s
LYING = 0.03  # m/s, a ball that meets the table more slowly does not bounce any more
MOST = 64  # contacts of one call, after which a ball lies

_NONE, _TABLE, _NET, _FLOOR, _RACKET = range(5)
SURFACES = ("none", "table", "net", "floor", "racket")
_BOXES = np.array(
    [
        [0.0, 0.0, -TABLE_THICKNESS, TABLE_LENGTH, TABLE_WIDTH, 0.0],
        [NET_X - NET_THICKNESS / 2, -NET_OVERHANG, 0.0, NET_X + NET_THICKNESS / 2, TABLE_WIDTH + NET_OVERHANG, NET_HEIGHT],
    ]
)


@dataclass(frozen=True, slots=True, eq=False)
class RacketMotion:
    """The racket at one instant. position: (3,) m, face centre. rotation: (3, 3) racket to table. velocity: (3,) m/s, of the centre.
    turning: (3,) rad/s, angular velocity in `table`."""

    position: Array
    rotation: Array
    velocity: Array
    turning: Array

    @property
    def normal(self) -> Array:
        """(3,) unit, of the face."""
        return self.rotation[:, 2]

    @property
    def row(self) -> Array:
        """(12,) position, normal, velocity, turning, for the kernels."""
        return np.concatenate([self.position, self.normal, self.velocity, self.turning])


@dataclass(frozen=True, slots=True, eq=False)
class Contact:
    """What the ball met. offset: m, from the face centre to the point of contact, for the racket. edge: whether it was the racket's rim or
    an edge of table or net."""

    surface: str
    before: BallState
    after: BallState
    offset: float = 0.0
    edge: bool = False


@njit(cache=True)
def _racket_at(rackets: Array, tick: float, t: float, out: Array) -> None:
    """Rows (n, 12) `tick` apart: Hermite in position, linear in the rest; the first and last row hold before and after."""
    last = len(rackets) - 1
    i = min(max(0, int(t / tick)), max(0, last - 1))
    start, end = rackets[i], rackets[min(i + 1, last)]
    u = min(1.0, max(0.0, t / tick - i))
    for k in range(3):
        m0, m1 = tick * start[6 + k], tick * end[6 + k]
        a, b = 2.0 * (start[k] - end[k]) + m0 + m1, 3.0 * (end[k] - start[k]) - 2.0 * m0 - m1
        out[k] = ((a * u + b) * u + m0) * u + start[k]
    for k in range(3, 12):
        out[k] = (1.0 - u) * start[k] + u * end[k]
    norm = math.sqrt(out[3] ** 2 + out[4] ** 2 + out[5] ** 2)
    for k in range(3, 6):
        out[k] /= norm


@njit(cache=True)
def _distance(surface: int, ball: Array, racket: Array, contact: float, radius: float, normal: Array) -> float:
    """m between the surfaces of ball and body; normal (3,): from the body's nearest point to the ball."""
    if surface == _FLOOR:
        normal[0], normal[1], normal[2] = 0.0, 0.0, 1.0
        return ball[2] - FLOOR_Z - BALL_RADIUS
    if surface == _RACKET:
        high = 0.0
        for k in range(3):
            high += racket[3 + k] * (ball[k] - racket[k])
        aside = 0.0
        for k in range(3):
            normal[k] = ball[k] - racket[k] - high * racket[3 + k]
            aside += normal[k] ** 2
        aside = math.sqrt(aside)
        beyond = max(0.0, aside - radius)
        for k in range(3):
            normal[k] = high * racket[3 + k] + (beyond / aside * normal[k] if beyond > 0.0 else 0.0)
        length = math.sqrt(high * high + beyond * beyond)
        reach = contact
    else:
        box, length = _BOXES[surface - 1], 0.0
        for k in range(3):
            normal[k] = ball[k] - min(max(ball[k], box[k]), box[3 + k])
            length += normal[k] ** 2
        length = math.sqrt(length)
        reach = contact if surface == _TABLE else BALL_RADIUS
    if length > 0.0:
        for k in range(3):
            normal[k] /= length
    else:  # deep inside, which only a ball put there can be
        normal[0], normal[1], normal[2] = 0.0, 0.0, 1.0
    return length - reach


@njit(cache=True)
def _rate(surface: int, ball: Array, racket: Array, contact: float, radius: float, normal: Array, gap: float) -> float:
    """m/s at which the distance grows."""
    rate = ball[3] * normal[0] + ball[4] * normal[1] + ball[5] * normal[2]
    if surface == _RACKET:
        v = np.empty(3)
        _point_velocity(ball, racket, contact, normal, gap, v)
        rate -= v[0] * normal[0] + v[1] * normal[1] + v[2] * normal[2]
    return rate


@njit(cache=True)
def _point_velocity(ball: Array, racket: Array, contact: float, normal: Array, gap: float, out: Array) -> None:
    """(3,) m/s of the racket's point nearest to the ball."""
    a0, a1, a2 = (
        ball[0] - (gap + contact) * normal[0] - racket[0],
        ball[1] - (gap + contact) * normal[1] - racket[1],
        ball[2] - (gap + contact) * normal[2] - racket[2],
    )
    out[0] = racket[6] + racket[10] * a2 - racket[11] * a1
    out[1] = racket[7] + racket[11] * a0 - racket[9] * a2
    out[2] = racket[8] + racket[9] * a1 - racket[10] * a0


@njit(cache=True)
def _look(
    surface: int, ball: Array, t: float, since: float, rackets: Array, tick: float, air: Array, contact: float, radius: float,
    trial: Array, work: Array, racket: Array, normal: Array,
) -> tuple[float, float]:  # fmt: skip
    """Distance (m) and its rate (m/s) `t` s after `ball`, which is `since` s after the first racket row; trial: the ball then."""
    if t > 0.0:
        step(ball, t, air, trial, work)
    else:
        trial[:] = ball
    if surface == _RACKET:
        _racket_at(rackets, tick, since + t, racket)
    gap = _distance(surface, trial, racket, contact, radius, normal)
    return gap, _rate(surface, trial, racket, contact, radius, normal, gap)


@njit(cache=True)
def _meets(
    surface: int, ball: Array, h: float, since: float, rackets: Array, tick: float, air: Array, contact: float, radius: float,
    trial: Array, work: Array, racket: Array, normal: Array,
) -> float:  # fmt: skip
    """Seconds within h, a small step, to the contact, or inf."""
    gap, rate = _look(surface, ball, 0.0, since, rackets, tick, air, contact, radius, trial, work, racket, normal)
    if gap <= 0.0 and rate <= 0.0:
        return 0.0
    end_gap, end_rate = _look(surface, ball, h, since, rackets, tick, air, contact, radius, trial, work, racket, normal)
    low, high = 0.0, h
    if (rate > 0.0 and end_gap <= 0.0) or (rate <= 0.0 and end_gap > 0.0 and end_rate > 0.0):  # by way of the furthest or the nearest point
        a, b = 0.0, h
        for _ in range(HALVINGS):
            middle = 0.5 * (a + b)
            turned = _look(surface, ball, middle, since, rackets, tick, air, contact, radius, trial, work, racket, normal)[1] > 0.0
            if turned == (rate > 0.0):
                a = middle
            else:
                b = middle
        if rate > 0.0:
            low = b
        else:
            high = b
            if _look(surface, ball, high, since, rackets, tick, air, contact, radius, trial, work, racket, normal)[0] > 0.0:
                return np.inf
    elif end_gap > 0.0:
        return np.inf
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if _look(surface, ball, middle, since, rackets, tick, air, contact, radius, trial, work, racket, normal)[0] <= 0.0:
            high = middle
        else:
            low = middle
    return high


@njit(cache=True)
def _rebound_edge(v: Array, w: Array, normal: Array, table: Array) -> None:
    """The table's rebound about another normal (3,), in place."""
    side = np.array([normal[2], normal[0], normal[1]])
    x = side - (side @ normal) * normal
    x /= math.sqrt(x @ x)
    y = np.array([normal[1] * x[2] - normal[2] * x[1], normal[2] * x[0] - normal[0] * x[2], normal[0] * x[1] - normal[1] * x[0]])
    lv, lw = np.array([v @ x, v @ y, v @ normal]), np.array([w @ x, w @ y, w @ normal])
    rebound_table(lv, lw, table)
    v[:] = lv[0] * x + lv[1] * y + lv[2] * normal
    w[:] = lw[0] * x + lw[1] * y + lw[2] * normal


@njit(cache=True)
def travel(
    ball: Array, since: float, until: float, rackets: Array, tick: float, air: Array, table: Array, rubber: Array, contact: float,
    radius: float, log: Array,
) -> tuple[int, float, bool]:  # fmt: skip
    """Fly ball (9,), in place, from `since` to `until` (s after the first of the racket rows (n, 12), `tick` apart).

    log (m, 22): surface, time, ball before, ball after, offset, edge of each contact. Returns how many, when it ended, and whether the ball
    is still in play: not on the floor, not lying. With more contacts than the log holds it lies.
    """
    work, trial, racket, normal, v = np.empty((8, 3)), np.empty(9), np.empty(12), np.empty(3), np.empty(3)
    soonest = np.empty(5)  # s, in which each surface can be reached at the earliest
    fastest = 1.0
    for i in range(len(rackets)):
        speed = math.sqrt(rackets[i, 6] ** 2 + rackets[i, 7] ** 2 + rackets[i, 8] ** 2)
        speed += radius * math.sqrt(rackets[i, 9] ** 2 + rackets[i, 10] ** 2 + rackets[i, 11] ** 2)
        fastest = max(fastest, 1.0 + speed)
    t, n = since, 0
    while until - t > 1e-12:
        speed = 1.0 + math.sqrt(ball[3] ** 2 + ball[4] ** 2 + ball[5] ** 2)
        _racket_at(rackets, tick, t, racket)
        for surface in range(1, 5):
            gap = _distance(surface, ball, racket, contact, radius, normal)
            soonest[surface] = gap / (speed + (fastest if surface == _RACKET else 0.0))
        safe = min(MAX_STEP * ease(ball, air), soonest[1:].min())
        if safe > SMALL_STEP:
            h = min(safe, until - t)
            step(ball, h, air, ball, work)
            t += h
            continue
        h, met, first = min(SMALL_STEP, until - t), _NONE, np.inf
        for surface in range(1, 5):
            if soonest[surface] > h:
                continue
            at = _meets(surface, ball, h, t, rackets, tick, air, contact, radius, trial, work, racket, normal)
            if at < first:
                met, first = surface, at
        if met == _NONE:
            step(ball, h, air, ball, work)
            t += h
            continue
        gap, rate = _look(met, ball, first, t, rackets, tick, air, contact, radius, trial, work, racket, normal)
        ball[:] = trial
        t += first
        row = log[n]
        row[0], row[1], row[20], row[21] = met, t, 0.0, 0.0
        row[2:11] = ball
        if met == _TABLE:
            if normal[2] > 1.0 - 1e-12:
                rebound_table(ball[3:6], ball[6:9], table)
            else:
                _rebound_edge(ball[3:6], ball[6:9], normal, table)
                row[21] = 1.0
        elif met == _NET:
            row[21] = 1.0 if abs(normal[2]) > 1e-12 else 0.0
            for k in range(3):
                ball[3 + k] -= (1.0 + NET_RESTITUTION) * rate * normal[k] + NET_DRAG * (ball[3 + k] - rate * normal[k])
                ball[6 + k] *= 1.0 - NET_DRAG
        elif met == _RACKET:
            _point_velocity(ball, racket, contact, normal, gap, v)
            rebound_racket(ball[3:6], ball[6:9], v, normal, rubber)
            across = normal[0] * racket[3] + normal[1] * racket[4] + normal[2] * racket[5]
            square = 0.0
            for k in range(3):
                square += (ball[k] - (gap + contact) * normal[k] - racket[k]) ** 2
            row[20], row[21] = math.sqrt(square), 1.0 if abs(across) < 1.0 - 1e-9 else 0.0
        row[11:20] = ball
        n += 1
        if met == _FLOOR or (met == _TABLE and -rate < LYING):
            return n, t, False
        if n == len(log):
            return n, t, False
    return n, t, True


def contacts_from(log: Array, start: float) -> list[Contact]:
    """The rows (n, 22) that `travel` fills, as contacts; start: s, of the first racket row."""
    rows = log.copy()
    rows.flags.writeable = False
    contacts = []
    for row, (surface, after, *_, offset, edge) in zip(rows, log.tolist(), strict=True):
        one, other = (BallState.trusted(start + after, row[k : k + 3], row[k + 3 : k + 6], row[k + 6 : k + 9]) for k in (2, 11))
        contacts.append(Contact(SURFACES[int(surface)], one, other, offset, edge > 0.0))
    return contacts


class World:
    """One ball at most, in flight or none. The truth: no node but the simulator may look. Raises OutOfRange for a contact height below
    LEAST_CONTACT."""

    def __init__(self, physics: Physics, racket_radius: float = RACKET_RADIUS) -> None:
        check_range("contact_height of the true world", physics.contact_height, LEAST_CONTACT, 0.1)
        self.physics, self.racket_radius = physics, racket_radius
        self.ball: BallState | None = None
        self._log = np.empty((MOST, 22))

    def advance(self, until: float, rackets: Sequence[RacketMotion] | Array, tick: float) -> list[Contact]:
        """Fly the ball to `until` (s); rackets: its motion every `tick` s, the last one at `until`. On the floor the ball is gone."""
        rows = rackets if isinstance(rackets, np.ndarray) else np.array([racket.row for racket in rackets])
        start = until - tick * (len(rows) - 1)
        physics = self.physics
        if self.ball is not None and until - self.ball.time > 1e-12:
            ball, since = self.ball.vector, self.ball.time - start
            models = physics.air.coefficients, physics.table.coefficients, physics.racket.coefficients
            n, now, alive = travel(ball, since, until - start, rows, tick, *models, physics.contact_height, self.racket_radius, self._log)
            ball.flags.writeable = False
            self.ball = BallState.trusted(start + now, ball[:3], ball[3:6], ball[6:9]) if alive else None
            return contacts_from(self._log[:n], start) if n else []
        return []
