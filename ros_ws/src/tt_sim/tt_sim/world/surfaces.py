"""The surfaces that a ball can touch, and its distance to each: table and net are boxes, the racket is a disc, the floor is a plane.

So face, edge, corner and rim are one rule: the ball touches where the distance from its centre to the nearest point of the body falls to
its radius.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import njit
from tt_core.constants import BALL_RADIUS, FLOOR_Z, NET_HEIGHT, NET_OVERHANG, NET_X, TABLE_LENGTH, TABLE_THICKNESS, TABLE_WIDTH
from tt_core.states import Array
from tt_core.text_enum import TextEnum

from .racket_motion import RacketInstant

NET_THICKNESS = 0.002  # m


class Surface(TextEnum):
    """What a ball can touch."""

    TABLE = "table"
    NET = "net"
    FLOOR = "floor"
    RACKET = "racket"


NONE, TABLE, NET, FLOOR, RACKET = range(5)  # the same for the kernels
BY_NUMBER = {TABLE: Surface.TABLE, NET: Surface.NET, FLOOR: Surface.FLOOR, RACKET: Surface.RACKET}


class Box(NamedTuple):
    """A body with edges along the axes: its least and largest coordinates, (3,) m each."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]


_TABLE_BOX = Box((0.0, 0.0, -TABLE_THICKNESS), (TABLE_LENGTH, TABLE_WIDTH, 0.0))
_NET_BOX = Box((NET_X - NET_THICKNESS / 2, -NET_OVERHANG, 0.0), (NET_X + NET_THICKNESS / 2, TABLE_WIDTH + NET_OVERHANG, NET_HEIGHT))


class BallShape(NamedTuple):
    """Sizes of ball and racket in contact.

    contact_height: m, from the surface of table or racket to the centre of a ball that touches it.
    racket_radius: m.
    """

    contact_height: float
    racket_radius: float


@njit(cache=True)
def distance(surface: int, ball: Array, racket: RacketInstant, shape: BallShape, normal: Array) -> float:
    """Return the distance (m) between the surfaces of a ball and a body.

    Args:
        surface: TABLE, NET, FLOOR or RACKET.
        ball: State, (9,); its position counts.
        racket: At the same instant.
        shape: Sizes.
        normal: (3,) is filled with the unit vector from the nearest point of the body to the ball.
    """
    if surface == FLOOR:
        normal[0], normal[1], normal[2] = 0.0, 0.0, 1.0
        return ball[2] - FLOOR_Z - BALL_RADIUS
    if surface == RACKET:
        return _to_disc(ball, racket, shape, normal)
    if surface == TABLE:
        return _to_box(ball, _TABLE_BOX, normal) - shape.contact_height
    return _to_box(ball, _NET_BOX, normal) - BALL_RADIUS


@njit(cache=True)
def _to_disc(ball: Array, racket: RacketInstant, shape: BallShape, normal: Array) -> float:
    high = 0.0
    for k in range(3):
        high += racket.normal[k] * (ball[k] - racket.position[k])
    aside = 0.0
    for k in range(3):
        normal[k] = ball[k] - racket.position[k] - high * racket.normal[k]
        aside += normal[k] ** 2
    aside = math.sqrt(aside)
    beyond = max(0.0, aside - shape.racket_radius)  # of the rim
    for k in range(3):
        normal[k] = high * racket.normal[k] + (beyond / aside * normal[k] if beyond > 0.0 else 0.0)
    length = math.sqrt(high * high + beyond * beyond)
    _make_unit(normal, length)
    return length - shape.contact_height


@njit(cache=True)
def _to_box(ball: Array, box: Box, normal: Array) -> float:
    length = 0.0
    for k in range(3):
        normal[k] = ball[k] - min(max(ball[k], box.low[k]), box.high[k])
        length += normal[k] ** 2
    length = math.sqrt(length)
    _make_unit(normal, length)
    return length


@njit(cache=True)
def _make_unit(normal: Array, length: float) -> None:
    if length > 0.0:
        for k in range(3):
            normal[k] /= length
    else:  # deep inside, which only a ball put there can be
        normal[0], normal[1], normal[2] = 0.0, 0.0, 1.0


@njit(cache=True)
def racket_point_velocity(ball: Array, racket: RacketInstant, reach: float, normal: Array) -> tuple[float, float, float]:
    """Return the velocity (m/s) of the racket's point nearest to a ball.

    Args:
        ball: State, (9,).
        racket: At the same instant.
        reach: m, from that point to the centre of the ball.
        normal: (3,) unit vector from that point to the ball.
    """
    a0 = ball[0] - reach * normal[0] - racket.position[0]
    a1 = ball[1] - reach * normal[1] - racket.position[1]
    a2 = ball[2] - reach * normal[2] - racket.position[2]
    v, w = racket.velocity, racket.turning
    return v[0] + w[1] * a2 - w[2] * a1, v[1] + w[2] * a0 - w[0] * a2, v[2] + w[0] * a1 - w[1] * a0


@njit(cache=True)
def distance_rate(surface: int, ball: Array, racket: RacketInstant, reach: float, normal: Array) -> float:
    """Return the rate (m/s) at which the distance grows; arguments as of `racket_point_velocity`."""
    rate = ball[3] * normal[0] + ball[4] * normal[1] + ball[5] * normal[2]
    if surface == RACKET:
        v = racket_point_velocity(ball, racket, reach, normal)
        rate -= v[0] * normal[0] + v[1] * normal[1] + v[2] * normal[2]
    return rate
