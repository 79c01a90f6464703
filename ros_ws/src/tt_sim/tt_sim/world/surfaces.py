"""Bodies that a ball can touch, and its distance to each: table and net are boxes, the racket is a disc, the floor is a plane.

The same rule holds for face, edge, corner and rim: the ball touches a body where the distance from the ball's centre to the nearest point
of the body falls to the ball's radius.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import njit
from tt_core.constants import BALL_RADIUS, FLOOR_Z, NET_HEIGHT, NET_OVERHANG, NET_X, TABLE_LENGTH, TABLE_THICKNESS, TABLE_WIDTH
from tt_core.text_enum import TextEnum

from .racket_motion import RacketInstant
from .vectors import Vector, dot, norm, plus

NET_THICKNESS = 0.002  # m


class Surface(TextEnum):
    """Bodies that a ball can touch."""

    TABLE = "table"
    NET = "net"
    FLOOR = "floor"
    RACKET = "racket"


NONE, TABLE, NET, FLOOR, RACKET = range(5)  # numbers of the surfaces for compiled functions; NONE is no surface
BY_NUMBER = {TABLE: Surface.TABLE, NET: Surface.NET, FLOOR: Surface.FLOOR, RACKET: Surface.RACKET}


class Box(NamedTuple):
    """A box with edges along the axes of `table`.

    Attributes:
        low: m, its least coordinates.
        high: m, its largest coordinates.
    """

    low: Vector
    high: Vector


_TABLE_BOX = Box(Vector(0.0, 0.0, -TABLE_THICKNESS), Vector(TABLE_LENGTH, TABLE_WIDTH, 0.0))
_NET_BOX = Box(
    Vector(NET_X - NET_THICKNESS / 2, -NET_OVERHANG, 0.0), Vector(NET_X + NET_THICKNESS / 2, TABLE_WIDTH + NET_OVERHANG, NET_HEIGHT)
)
_UP = Vector(0.0, 0.0, 1.0)


class BallShape(NamedTuple):
    """Sizes that decide when the ball touches a body.

    Attributes:
        contact_height: m, from the surface of table or racket to the centre of a ball that touches it.
        racket_radius: m, radius of the racket's disc.
    """

    contact_height: float
    racket_radius: float


class Gap(NamedTuple):
    """Distance between the ball and a body.

    Attributes:
        distance: m, between their surfaces; negative if the ball is inside the body.
        normal: Unit vector from the nearest point of the body to the centre of the ball.
    """

    distance: float
    normal: Vector


@njit(cache=True)
def gap_to(surface: int, ball: Vector, racket: RacketInstant, shape: BallShape) -> Gap:
    """Compute the distance between the ball and a body.

    Args:
        surface: TABLE, NET, FLOOR or RACKET.
        ball: m, centre of the ball.
        racket: The racket at the same time; used if it is the body.
        shape: Sizes of ball and racket.
    """
    if surface == FLOOR:
        return Gap(ball.z - FLOOR_Z - BALL_RADIUS, _UP)
    if surface == RACKET:
        away = _from_disc(ball, racket, shape.racket_radius)
    elif surface == TABLE:
        away = _from_box(ball, _TABLE_BOX)
    else:
        away = _from_box(ball, _NET_BOX)
    offset, length = away.offset, away.length
    # a centre that is deep inside, which only a ball put there can have, has no nearest point
    normal = Vector(offset.x / length, offset.y / length, offset.z / length) if length > 0.0 else _UP
    return Gap(length - (BALL_RADIUS if surface == NET else shape.contact_height), normal)


class _Away(NamedTuple):
    """The vector from the nearest point of a body to the centre of the ball, and its length, m."""

    offset: Vector
    length: float


@njit(cache=True)
def _from_disc(ball: Vector, racket: RacketInstant, radius: float) -> _Away:
    offset, n = plus(ball, -1.0, racket.position), racket.normal
    high = dot(n, offset)
    aside = plus(offset, -high, n)
    length = norm(aside)
    beyond = max(0.0, length - radius)  # of the rim
    share = beyond / length if beyond > 0.0 else 0.0
    nearest = Vector(high * n.x + share * aside.x, high * n.y + share * aside.y, high * n.z + share * aside.z)
    return _Away(nearest, math.sqrt(high * high + beyond * beyond))


@njit(cache=True)
def _from_box(ball: Vector, box: Box) -> _Away:
    offset = Vector(
        ball.x - min(max(ball.x, box.low.x), box.high.x),
        ball.y - min(max(ball.y, box.low.y), box.high.y),
        ball.z - min(max(ball.z, box.low.z), box.high.z),
    )
    return _Away(offset, norm(offset))


@njit(cache=True)
def racket_point_velocity(arm: Vector, racket: RacketInstant) -> Vector:
    """Return the velocity (m/s) of a point of the racket.

    Args:
        arm: m, from the centre of the racket's face to the point, in `table`.
        racket: The racket.
    """
    v, w = racket.velocity, racket.turning
    return Vector(v.x + w.y * arm.z - w.z * arm.y, v.y + w.z * arm.x - w.x * arm.z, v.z + w.x * arm.y - w.y * arm.x)
