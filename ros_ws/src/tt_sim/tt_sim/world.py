"""The true ball between table, net, floor and racket. Contacts are found at their instant, between two states of the racket."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from tt_core.bounce import rebound_racket, rebound_table
from tt_core.constants import BALL_RADIUS, FLOOR_Z, NET_HEIGHT, NET_OVERHANG, NET_X, TABLE_LENGTH, TABLE_WIDTH
from tt_core.flight import MAX_STEP, step
from tt_core.physics import Physics
from tt_core.states import Array, BallState

RACKET_RADIUS = 0.075  # m, a disc of a usual blade's width
NET_LOSS = 0.9  # share of the speed that the net takes, an assumption: a ball that meets it is lost anyway

_NONE, _TABLE, _NET, _FLOOR, _RACKET = range(5)
SURFACES = ("none", "table", "net", "floor", "racket")


@dataclass(frozen=True, slots=True, eq=False)
class RacketMotion:
    """The racket at one instant. position: (3,) m, face centre. rotation: (3, 3) racket to table. velocity: (3,) m/s, of the centre."""

    position: Array
    rotation: Array
    velocity: Array

    @property
    def normal(self) -> Array:
        """(3,) unit, of the face."""
        return self.rotation[:, 2]

    @property
    def row(self) -> Array:
        """(9,) position, normal, velocity, for the kernel."""
        return np.concatenate([self.position, self.normal, self.velocity])


@dataclass(frozen=True, slots=True, eq=False)
class Contact:
    """What the ball met. offset: m, from the face centre to the point of contact, for the racket."""

    surface: str
    before: BallState
    after: BallState
    offset: float = 0.0


@njit(cache=True)
def _racket_at(start: Array, end: Array, tick: float, t: float, out: Array) -> None:
    """Hermite in position, linear in normal and velocity."""
    u = t / tick
    for k in range(3):
        m0, m1 = tick * start[6 + k], tick * end[6 + k]
        a, b = 2.0 * (start[k] - end[k]) + m0 + m1, 3.0 * (end[k] - start[k]) - 2.0 * m0 - m1
        out[k] = ((a * u + b) * u + m0) * u + start[k]
        out[3 + k] = (1.0 - u) * start[3 + k] + u * end[3 + k]
        out[6 + k] = (1.0 - u) * start[6 + k] + u * end[6 + k]
    norm = math.sqrt(out[3] ** 2 + out[4] ** 2 + out[5] ** 2)
    for k in range(3, 6):
        out[k] /= norm


@njit(cache=True)
def _gap(surface: int, ball: Array, racket: Array, contact: float) -> float:
    """m from the ball to the surface's plane, negative in it."""
    if surface == _TABLE:
        return ball[2] - contact
    if surface == _FLOOR:
        return ball[2] - FLOOR_Z - BALL_RADIUS
    if surface == _NET:
        return abs(ball[0] - NET_X) - (BALL_RADIUS if ball[2] < NET_HEIGHT else 0.0)
    d = 0.0
    for k in range(3):
        d += racket[3 + k] * (ball[k] - racket[k])
    return abs(d) - contact


@njit(cache=True)
def _offset(ball: Array, racket: Array) -> float:
    d, square = 0.0, 0.0
    for k in range(3):
        d += racket[3 + k] * (ball[k] - racket[k])
        square += (ball[k] - racket[k]) ** 2
    return math.sqrt(max(0.0, square - d * d))


@njit(cache=True)
def _meets(surface: int, ball: Array, racket: Array, radius: float) -> bool:
    """Whether the surface extends to where the ball meets its plane."""
    if surface == _TABLE:
        return 0.0 <= ball[0] <= TABLE_LENGTH and 0.0 <= ball[1] <= TABLE_WIDTH
    if surface == _NET:
        return 0.0 < ball[2] < NET_HEIGHT + BALL_RADIUS and -NET_OVERHANG <= ball[1] <= TABLE_WIDTH + NET_OVERHANG
    return surface == _FLOOR or _offset(ball, racket) <= radius


@njit(cache=True)
def first_contact(
    ball: Array,
    since: float,
    h: float,
    start: Array,
    end: Array,
    tick: float,
    air: Array,
    contact: float,
    radius: float,
    out: Array,
    at: Array,
) -> tuple[int, float]:
    """(surface, seconds) of the first contact within h seconds; out: the ball then or after h; at: the racket then.

    since: s of the tick that are over, on the clock of the racket rows start and end, tick seconds apart.
    """
    work, trial = np.empty((8, 3)), np.empty(9)
    best, surface = np.inf, _NONE
    for kind in (_TABLE, _NET, _FLOOR, _RACKET):
        _racket_at(start, end, tick, since, at)
        f_low = _gap(kind, ball, at, contact)
        step(ball, h, air, trial, work)
        _racket_at(start, end, tick, since + h, at)
        f_high = _gap(kind, trial, at, contact)
        crossed = f_low > 1e-12 >= f_high
        if kind == _NET and not crossed:
            crossed = (ball[0] - NET_X) * (trial[0] - NET_X) < 0.0
        if not crossed:
            continue
        low, high = 0.0, h
        for _ in range(60):  # bisection: the gap to the net jumps
            middle = 0.5 * (low + high)
            step(ball, middle, air, trial, work)
            _racket_at(start, end, tick, since + middle, at)
            inside = _gap(kind, trial, at, contact) <= 0.0
            if kind == _NET and (ball[0] - NET_X) * (trial[0] - NET_X) < 0.0:
                inside = True
            if inside:
                high = middle
            else:
                low = middle
        step(ball, high, air, trial, work)
        _racket_at(start, end, tick, since + high, at)
        if high < best and _meets(kind, trial, at, radius):
            best, surface = high, kind
    seconds = min(best, h)
    step(ball, seconds, air, out, work)
    _racket_at(start, end, tick, since + seconds, at)
    return surface, seconds


class World:
    """One ball at most, in flight or none. The truth: no node but the simulator may look."""

    def __init__(self, physics: Physics, racket_radius: float = RACKET_RADIUS) -> None:
        self.physics, self.racket_radius = physics, racket_radius
        self.ball: BallState | None = None

    def advance(self, until: float, start: RacketMotion, end: RacketMotion, tick: float) -> list[Contact]:
        """Fly the ball to `until` (s); the racket moves from start, `tick` seconds before, to end. On the floor the ball is gone."""
        contacts: list[Contact] = []
        while self.ball is not None and until - self.ball.time > 1e-12:
            h = min(until - self.ball.time, MAX_STEP)
            since = tick - (until - self.ball.time)
            state, racket = np.empty(9), np.empty(9)
            air, contact = self.physics.air.coefficients, self.physics.contact_height
            row = self.ball.vector
            kind, seconds = first_contact(row, since, h, start.row, end.row, tick, air, contact, self.racket_radius, state, racket)
            time = self.ball.time + seconds
            self.ball = BallState.from_vector(time, state)
            if kind == _NONE:
                continue
            before = self.ball
            if kind == _TABLE:
                state[2] = contact
                rebound_table(state[3:6], state[6:9], self.physics.table.coefficients)
            elif kind == _RACKET:
                rebound_racket(state[3:6], state[6:9], racket[6:9], racket[3:6], self.physics.racket.coefficients)
            elif kind == _NET:
                state[3:6] *= [NET_LOSS - 1.0, 1.0 - NET_LOSS, 1.0 - NET_LOSS]
                state[6:9] *= 1.0 - NET_LOSS
                state[0] = NET_X - math.copysign(BALL_RADIUS + 1e-6, before.velocity[0])
            after = BallState.from_vector(time, state)
            contacts.append(Contact(SURFACES[kind], before, after, _offset(state, racket) if kind == _RACKET else 0.0))
            self.ball = None if kind == _FLOOR else after
        return contacts
