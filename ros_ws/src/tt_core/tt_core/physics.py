"""Models of air, table and racket in one object: the physics that the robot assumes, or the true physics of the simulator."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numba import njit

from .arrays import Array
from .bounce import RacketCoefficients, RacketRebound, TableCoefficients, TableRebound, racket_coefficients, table_coefficients
from .constants import BALL_RADIUS
from .errors import check_range
from .flight import Aerodynamics, AirCoefficients, air_coefficients


class PhysicsCoefficients(NamedTuple):
    """Coefficients of `Physics` with names, as the compiled functions (kernels) take them."""

    air: AirCoefficients
    table: TableCoefficients
    racket: RacketCoefficients
    contact_height: float  # m


@njit(cache=True)
def physics_coefficients(row: Array) -> PhysicsCoefficients:
    """Give names to the coefficients in an array.

    Args:
        row: (19,) `Physics.coefficients`: 8 of the air, 3 of the table, 7 of the racket, and the contact height.
    """
    return PhysicsCoefficients(air_coefficients(row[:8]), table_coefficients(row[8:11]), racket_coefficients(row[11:18]), row[18])


@dataclass(frozen=True)
class Physics:
    """Models of everything that acts on the ball.

    Attributes:
        air: Gravity, drag and Magnus force.
        table: Rebound from the table.
        racket: Rebound from the racket.
        contact_height: m, from a surface to the centre of a ball that touches it, 0 to 0.1; the dissertation uses 0.

    Raises:
        NotFinite: `contact_height` is NaN or infinite.
        OutOfRange: `contact_height` is outside its range.
    """

    air: Aerodynamics = field(default_factory=Aerodynamics.liu)
    table: TableRebound = field(default_factory=TableRebound.liu)
    racket: RacketRebound = field(default_factory=RacketRebound.liu)
    contact_height: float = BALL_RADIUS

    def __post_init__(self) -> None:
        check_range("contact_height", self.contact_height, 0.0, 0.1)

    @classmethod
    def liu(cls, contact_height: float = BALL_RADIUS) -> Physics:
        """Return Liu's models of air, table and rubber, those of the dissertation.

        The dissertation is "Racket Control and Spinning Ball Measurement for Table Tennis Robot" (Nagoya University).

        Args:
            contact_height: m, from a surface to the centre of a ball that touches it, 0 to 0.1.
        """
        return cls(Aerodynamics.liu(), TableRebound.liu(), RacketRebound.liu(), contact_height)

    @classmethod
    def fitted(cls, contact_height: float = BALL_RADIUS) -> Physics:
        """Return the three models that were fitted to real balls and rubbers."""
        return cls(Aerodynamics.measured(), TableRebound.measured(), RacketRebound.measured(), contact_height)

    measured = fitted  # its name as a value of the parameter `physics`

    @cached_property
    def coefficients(self) -> Array:
        """All coefficients as one array (19,), in the order of `PhysicsCoefficients`; the form in which Python passes them to kernels."""
        return np.concatenate([self.air.coefficients, self.table.coefficients, self.racket.coefficients, [self.contact_height]])
