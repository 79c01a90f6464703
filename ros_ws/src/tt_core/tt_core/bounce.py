"""Rebounds of the ball from the table and from the racket, which take no time (dissertation Sections 3.3 and 3.4).

The dissertation is "Racket Control and Spinning Ball Measurement for Table Tennis Robot" (Nagoya University); numbers such as (3.15) are
its equations. A rebound adds an impulse along the surface normal n and an impulse along the slip of the contact point to the velocity. The
second impulse also changes the spin. Kernels are compiled; they work on arrays (3,) in place and do not validate. Python passes
coefficients to them as one array, to which `table_coefficients` and `racket_coefficients` give names.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numba import njit

from .arrays import Array
from .constants import BALL_RADIUS
from .errors import OutOfRange, check_array, check_range
from .params import check, param
from .states import RacketState


class TableCoefficients(NamedTuple):
    """Coefficients of `TableRebound` under the same names, as the compiled functions (kernels) take them."""

    restitution: float
    friction: float
    grip: float


class RacketCoefficients(NamedTuple):
    """Coefficients of `RacketRebound` as the compiled functions (kernels) take them.

    They have the same names. Only `turn`, the change of spin over the tangential change of velocity in rad/m, stands for `rotational`.
    """

    restitution: float
    restitution_drop: float
    restitution_least: float
    tangential: float
    tangential_drop: float
    tangential_least: float
    turn: float


@njit(cache=True)
def table_coefficients(row: Array) -> TableCoefficients:
    """Give names to the coefficients in the array `TableRebound.coefficients` (3,)."""
    return TableCoefficients(row[0], row[1], row[2])


@njit(cache=True)
def racket_coefficients(row: Array) -> RacketCoefficients:
    """Give names to the coefficients in the array `RacketRebound.coefficients` (7,)."""
    return RacketCoefficients(row[0], row[1], row[2], row[3], row[4], row[5], row[6])


@dataclass(frozen=True)
class TableRebound:
    """Model of the ball's rebound from the table: the contact point slips with friction, or it grips.

    Raises:
        OutOfRange: A coefficient is outside its range.
        NotFinite: A coefficient is NaN or infinite.
    """

    restitution: float = param(0.93, "", "share of the vertical speed after the bounce, e_t of (3.7), Section 3.3", low=0.0, high=1.0)
    friction: float = param(0.25, "", "friction coefficient while the ball slips, mu of (3.8), Section 3.3", low=0.0, high=2.0)
    grip: float = param(
        1.0, "", "tangential impulse in grip over that of rolling, 1 is (3.14); above 1 the table gives some of it back", low=0.0, high=2.0
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)

    @classmethod
    def liu(cls) -> TableRebound:
        """Return the model of Liu's dissertation, (3.4)-(3.18)."""
        return cls()

    @classmethod
    def measured(cls) -> TableRebound:
        """Return a model of real balls. Measured values are: restitution 0.90 to 0.92, friction 0.26, grip 1.1 to 1.4."""
        return cls(0.91, 0.26, 1.25)

    @cached_property
    def coefficients(self) -> Array:
        """All coefficients as one array (3,), in the order of `TableCoefficients`; the form in which Python passes them to kernels."""
        return np.array(TableCoefficients(self.restitution, self.friction, self.grip))

    def after(self, velocity: Array, spin: Array) -> tuple[Array, Array]:
        """Return velocity and spin of the ball after a contact with the table.

        Args:
            velocity: (3,) m/s before the contact, in `table`.
            spin: (3,) rad/s before the contact, in `table`.

        Returns:
            Velocity (3,) in m/s and spin (3,) in rad/s after the contact, in `table`.

        Raises:
            OutOfRange: The ball does not move down.
            BadShape: An array has another shape.
            NotFinite: A number is NaN or infinite.
        """
        v, w = check_array("velocity", velocity, (3,)).copy(), check_array("spin", spin, (3,)).copy()
        if v[2] >= 0.0:
            raise OutOfRange("velocity z at the table", v[2], -math.inf, 0.0)
        _rebound_table_entry(v, w, self.coefficients)
        return v, w


@dataclass(frozen=True)
class RacketRebound:
    """Model of the ball's rebound from the rubber of the racket, (3.25)-(3.28) of the dissertation.

    The restitution along the face normal is max(restitution_least, restitution - restitution_drop v_n) for the approach speed v_n. The slip
    velocity u of the contact point changes by -k u with k = max(tangential_least, tangential - tangential_drop |u|). The spin changes by
    (rotational / tangential) r times the cross product of slip impulse and normal (4.14), so the ratio of the two changes is constant.

    Raises:
        OutOfRange: A coefficient is outside its range, or a least value is above the value that it bounds.
        NotFinite: A coefficient is NaN or infinite.
    """

    restitution: float = param(0.73, "", "restitution along the face normal, e_r, Section 3.4", low=0.0, high=1.0)
    tangential: float = param(0.615, "", "share of the slip velocity that the rubber takes, k_pv, Section 3.4", low=1e-3, high=2.0)
    rotational: float = param(2570.0, "1/m^2", "change of spin per slip velocity and radius, k_pw, Section 3.4", low=0.0, high=2e4)
    restitution_drop: float = param(0.0, "s/m", "fall of the restitution with the approach speed", low=0.0, high=1.0)
    restitution_least: float = param(0.0, "", "least restitution at high approach speeds", low=0.0, high=1.0)
    tangential_drop: float = param(0.0, "s/m", "fall of `tangential` with the slip speed", low=0.0, high=1.0)
    tangential_least: float = param(0.0, "", "least value of `tangential` at high slip speeds", low=0.0, high=2.0)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)
        check_range("restitution_least", self.restitution_least, 0.0, self.restitution)
        check_range("tangential_least", self.tangential_least, 0.0, self.tangential)

    @classmethod
    def liu(cls) -> RacketRebound:
        """Return the model of Liu's dissertation."""
        return cls()

    @classmethod
    def measured(cls) -> RacketRebound:
        """Return a model of real rubber.

        Its restitution is e = 0.917 - 0.0214 v_n, at least 0.665. Its tangential coefficient falls from 0.73 to 0.65. That it does so over
        a slip of 8 m/s is an assumption. The impulse turns a thin shell: k_w = 3 k_v / (2 r^2).
        """
        return cls(0.917, 0.73, 0.73 * 1.5 / BALL_RADIUS**2, 0.0214, 0.665, 0.01, 0.65)

    @cached_property
    def coefficients(self) -> Array:
        """All coefficients as one array (7,), in the order of `RacketCoefficients`; the form in which Python passes them to kernels."""
        return np.array(
            RacketCoefficients(
                restitution=self.restitution,
                restitution_drop=self.restitution_drop,
                restitution_least=self.restitution_least,
                tangential=self.tangential,
                tangential_drop=self.tangential_drop,
                tangential_least=self.tangential_least,
                turn=self.turn,
            )
        )

    @property
    def turn(self) -> float:
        """Change of the spin over the tangential change of the velocity, k_w r / k_v of (4.11), rad/m."""
        return self.rotational * BALL_RADIUS / self.tangential

    def after(self, velocity: Array, spin: Array, racket: RacketState) -> tuple[Array, Array]:
        """Return velocity and spin of the ball after a contact with the racket. Both faces of the racket have this rubber.

        Args:
            velocity: (3,) m/s before the contact, in `table`.
            spin: (3,) rad/s before the contact, in `table`.
            racket: The racket at the contact.

        Returns:
            Velocity (3,) in m/s and spin (3,) in rad/s after the contact, in `table`.

        Raises:
            BadShape: An array has another shape.
            NotFinite: A number is NaN or infinite.
        """
        v, w = check_array("velocity", velocity, (3,)).copy(), check_array("spin", spin, (3,)).copy()
        _rebound_racket_entry(v, w, racket.velocity, racket.normal, self.coefficients)
        return v, w


@njit(cache=True)
def rebound_table(v: Array, w: Array, table: TableCoefficients) -> None:
    """Apply the rebound from the table to velocity and spin of the ball, (3.15)-(3.18) of the dissertation.

    The contact point slips if the impulse of friction is smaller than that of grip, otherwise it grips.

    Args:
        v: (3,) m/s in `table`, changed in place.
        w: (3,) rad/s in `table`, changed in place.
        table: Coefficients.
    """
    ux, uy = v[0] - BALL_RADIUS * w[1], v[1] + BALL_RADIUS * w[0]  # of the contact point
    slip = math.sqrt(ux * ux + uy * uy)
    share = 0.4 * table.grip  # of the slip that is taken away; 0.4 makes a thin shell roll (3.14)
    if slip > 0.0:
        share = min(share, table.friction * (1.0 + table.restitution) * abs(v[2]) / slip)
    v[0] -= share * ux
    v[1] -= share * uy
    v[2] *= -table.restitution
    w[0] -= 1.5 * share / BALL_RADIUS * uy
    w[1] += 1.5 * share / BALL_RADIUS * ux


@njit(cache=True)
def rebound_racket(v: Array, w: Array, racket_velocity: Array, normal: Array, rubber: RacketCoefficients) -> None:
    """Apply the rebound from the racket to velocity and spin of the ball, (3.25)-(3.28) of the dissertation.

    Args:
        v: (3,) m/s in `table`, changed in place.
        w: (3,) rad/s in `table`, changed in place.
        racket_velocity: (3,) m/s in `table`.
        normal: (3,) unit normal of either face, in `table`.
        rubber: Coefficients.
    """
    u0, u1, u2 = v[0] - racket_velocity[0], v[1] - racket_velocity[1], v[2] - racket_velocity[2]
    n0, n1, n2 = normal[0], normal[1], normal[2]
    un = u0 * n0 + u1 * n1 + u2 * n2
    if un > 0.0:  # the ball meets the other face
        n0, n1, n2, un = -n0, -n1, -n2, -un
    s0 = u0 - un * n0 - BALL_RADIUS * (w[1] * n2 - w[2] * n1)
    s1 = u1 - un * n1 - BALL_RADIUS * (w[2] * n0 - w[0] * n2)
    s2 = u2 - un * n2 - BALL_RADIUS * (w[0] * n1 - w[1] * n0)
    slip = math.sqrt(s0 * s0 + s1 * s1 + s2 * s2)
    restitution = max(rubber.restitution_least, rubber.restitution + rubber.restitution_drop * un)
    k = max(rubber.tangential_least, rubber.tangential - rubber.tangential_drop * slip)
    push = -(1.0 + restitution) * un
    v[0] += push * n0 - k * s0
    v[1] += push * n1 - k * s1
    v[2] += push * n2 - k * s2
    turn = rubber.turn * k
    w[0] += turn * (n1 * s2 - n2 * s1)
    w[1] += turn * (n2 * s0 - n0 * s2)
    w[2] += turn * (n0 * s1 - n1 * s0)


@njit(cache=True)
def _rebound_table_entry(v: Array, w: Array, table: Array) -> None:
    """Call `rebound_table` from Python."""
    rebound_table(v, w, table_coefficients(table))


@njit(cache=True)
def _rebound_racket_entry(v: Array, w: Array, racket_velocity: Array, normal: Array, rubber: Array) -> None:
    """Call `rebound_racket` from Python."""
    rebound_racket(v, w, racket_velocity, normal, racket_coefficients(rubber))
