"""Factors on the coefficients of air, table and rubber: how balls, tables and rubbers differ from their models."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from .arrays import Array
from .physics import Physics

FACTORS = ("drag", "lift", "restitution", "friction", "grip", "rubber_restitution", "rubber_grip")
OF_BALL = 5  # the first 5 FACTORS can be learnt from a flight with a bounce on the table, the others only from a contact with the racket
MOST_TANGENTIAL = 0.79  # above 0.8 a shell would come back from the rubber faster than it slipped
LARGEST_LOG_FACTOR = math.log(2.0)  # largest absolute logarithm of a factor: no ball has twice the drag of another one
MOST_OF_TABLE = 2.0  # friction and grip, upper ends of their ranges


def scaled(physics: Physics, logarithms: Sequence[float] | Array) -> Physics:
    """Return the models with their coefficients multiplied by factors that are given as logarithms.

    Args:
        physics: The models.
        logarithms: Natural logarithms of the factors, in the order of FACTORS. Factors below 1/2 or above 2 are replaced by these
            bounds. Logarithms at the end may be left out; their factors are 1.

    Returns:
        The new models, with the limits that `multiplied` describes.
    """
    return multiplied(physics, [math.exp(min(LARGEST_LOG_FACTOR, max(-LARGEST_LOG_FACTOR, float(value)))) for value in logarithms])


def multiplied(physics: Physics, factors: Sequence[float]) -> Physics:
    """Return the models with their coefficients multiplied by factors.

    The products are limited: the restitution of table and racket to 1, friction and grip of the table to MOST_OF_TABLE, and the tangential
    coefficient of the rubber to MOST_TANGENTIAL, so that the rubber adds no energy to the ball.

    Args:
        physics: The models.
        factors: In the order of FACTORS. Factors at the end may be left out; they are 1.
    """
    drag, lift, restitution, friction, grip, bounce, rubber = (*factors, *(len(FACTORS) - len(factors)) * (1.0,))
    air, table, racket = physics.air, physics.table, physics.racket
    bounce = min(bounce, 1.0 / racket.restitution)
    rubber = min(rubber, MOST_TANGENTIAL / racket.tangential)
    return replace(
        physics,
        air=replace(
            air,
            drag=air.drag * drag,
            drag_h=air.drag_h * drag,
            lift=air.lift * lift,
            lift_h=air.lift_h * lift,
            lift_ratio=air.lift_ratio * lift,
        ),
        table=replace(
            table,
            restitution=min(1.0, table.restitution * restitution),
            friction=min(MOST_OF_TABLE, table.friction * friction),
            grip=min(MOST_OF_TABLE, table.grip * grip),
        ),
        racket=replace(
            racket,
            restitution=racket.restitution * bounce,
            restitution_least=racket.restitution_least * bounce,
            tangential=racket.tangential * rubber,
            tangential_least=racket.tangential_least * rubber,
            rotational=racket.rotational * rubber,
        ),
    )
