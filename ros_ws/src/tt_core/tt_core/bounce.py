"""The ball on the table and on the racket: instant rebounds (dissertation Sections 3.3 and 3.4).

A rebound adds to the velocity an impulse along the surface normal n and one along the slip of the contact point, and to the spin what the
second one turns. Kernels work on (3,) arrays in place and do not validate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

from .constants import BALL_RADIUS
from .errors import OutOfRange, check_array, check_range
from .params import check, param
from .states import Array, RacketState


@dataclass(frozen=True)
class TableRebound:
    """Ball and table: slip with friction, or grip.

    restitution: e_t (3.7). friction: mu (3.8). grip: tangential impulse in grip over that of rolling, 1 is (3.14); above 1 the table
    gives some of it back.
    """

    restitution: float = param(0.93, "", "share of the vertical speed after the bounce, e_t of (3.7), Section 3.3", low=0.0, high=1.0)
    friction: float = param(0.25, "", "friction coefficient while the ball slips, mu of (3.8), Section 3.3", low=0.0, high=2.0)
    grip: float = param(1.0, "", "tangential impulse in grip over that of rolling, 1 is (3.14)", low=0.0, high=2.0)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)

    @classmethod
    def liu(cls) -> TableRebound:
        """The dissertation's (3.4)-(3.18)."""
        return cls()

    @classmethod
    def measured(cls) -> TableRebound:
        """Real balls: restitution 0.90 to 0.92, friction 0.26, grip 1.1 to 1.4."""
        return cls(0.91, 0.26, 1.25)

    @cached_property
    def coefficients(self) -> Array:
        return np.array([self.restitution, self.friction, self.grip])

    def after(self, velocity: Array, spin: Array) -> tuple[Array, Array]:
        """velocity (3,) m/s and spin (3,) rad/s after the contact, in `table`.

        Raises OutOfRange unless the ball moves down, BadShape, NotFinite.
        """
        v, w = check_array("velocity", velocity, (3,)).copy(), check_array("spin", spin, (3,)).copy()
        if v[2] >= 0.0:
            raise OutOfRange("velocity z at the table", v[2], -math.inf, 0.0)
        rebound_table(v, w, self.coefficients)
        return v, w


@dataclass(frozen=True)
class RacketRebound:
    """Ball and rubber (3.25)-(3.28).

    Normal restitution max(restitution_least, restitution - restitution_drop v_n) for the approach speed v_n. Slip u of the contact point is
    answered by -k u with k = max(tangential_least, tangential - tangential_drop |u|); the spin gains (rotational/tangential) r times the
    cross product of slip impulse and normal (4.14), so the ratio of both is constant.
    """

    restitution: float = param(0.73, "", "restitution along the face normal, e_r, Section 3.4", low=0.0, high=1.0)
    tangential: float = param(0.615, "", "share of the slip velocity that the rubber takes, k_pv, Section 3.4", low=1e-3, high=2.0)
    rotational: float = param(2570.0, "1/m^2", "spin change per slip, k_pw, Section 3.4", low=0.0, high=2e4)
    restitution_drop: float = param(0.0, "s/m", "fall of the restitution with the approach speed", low=0.0, high=1.0)
    restitution_least: float = param(0.0, "", "least restitution", low=0.0, high=1.0)
    tangential_drop: float = param(0.0, "s/m", "fall of `tangential` with the slip speed", low=0.0, high=1.0)
    tangential_least: float = param(0.0, "", "least `tangential`", low=0.0, high=2.0)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)
        check_range("restitution_least", self.restitution_least, 0.0, self.restitution)
        check_range("tangential_least", self.tangential_least, 0.0, self.tangential)

    @classmethod
    def liu(cls) -> RacketRebound:
        """The dissertation's constants."""
        return cls()

    @classmethod
    def measured(cls) -> RacketRebound:
        """Real rubber: e = 0.917 - 0.0214 v_n down to 0.665; transfer 0.73 down to 0.65, here over 8 m/s of slip, an assumption;
        the impulse turns a thin shell, k_w = 3 k_v / (2 r^2)."""
        return cls(0.917, 0.73, 0.73 * 1.5 / BALL_RADIUS**2, 0.0214, 0.665, 0.01, 0.65)

    @cached_property
    def coefficients(self) -> Array:
        return np.array(
            [
                self.restitution,
                self.restitution_drop,
                self.restitution_least,
                self.tangential,
                self.tangential_drop,
                self.tangential_least,
                self.turn,
            ]
        )

    @property
    def turn(self) -> float:
        """k_w r / k_v, rad/m: spin change over tangential velocity change, (4.11)."""
        return self.rotational * BALL_RADIUS / self.tangential

    def after(self, velocity: Array, spin: Array, racket: RacketState) -> tuple[Array, Array]:
        """velocity (3,) m/s and spin (3,) rad/s after the contact, in `table`; both faces of the racket have this rubber.

        Raises BadShape, NotFinite.
        """
        v, w = check_array("velocity", velocity, (3,)).copy(), check_array("spin", spin, (3,)).copy()
        rebound_racket(v, w, racket.velocity, racket.normal, self.coefficients)
        return v, w


@njit(cache=True)
def rebound_table(v: Array, w: Array, c: Array) -> None:
    """(3.15)-(3.18) in place; slip and grip meet where their impulses are equal."""
    ux, uy = v[0] - BALL_RADIUS * w[1], v[1] + BALL_RADIUS * w[0]
    slip = math.sqrt(ux * ux + uy * uy)
    share = 0.4 * c[2]
    if slip > 0.0:
        share = min(share, c[1] * (1.0 + c[0]) * abs(v[2]) / slip)
    v[0] -= share * ux
    v[1] -= share * uy
    v[2] *= -c[0]
    w[0] -= 1.5 * share / BALL_RADIUS * uy
    w[1] += 1.5 * share / BALL_RADIUS * ux


@njit(cache=True)
def rebound_racket(v: Array, w: Array, racket_velocity: Array, normal: Array, c: Array) -> None:
    """(3.25)-(3.28) in place, for a racket with that velocity and unit normal."""
    u0, u1, u2 = v[0] - racket_velocity[0], v[1] - racket_velocity[1], v[2] - racket_velocity[2]
    n0, n1, n2 = normal[0], normal[1], normal[2]
    un = u0 * n0 + u1 * n1 + u2 * n2
    if un > 0.0:  # the other face
        n0, n1, n2, un = -n0, -n1, -n2, -un
    s0 = u0 - un * n0 - BALL_RADIUS * (w[1] * n2 - w[2] * n1)
    s1 = u1 - un * n1 - BALL_RADIUS * (w[2] * n0 - w[0] * n2)
    s2 = u2 - un * n2 - BALL_RADIUS * (w[0] * n1 - w[1] * n0)
    slip = math.sqrt(s0 * s0 + s1 * s1 + s2 * s2)
    restitution = max(c[2], c[0] + c[1] * un)
    k = max(c[5], c[3] - c[4] * slip)
    push = -(1.0 + restitution) * un
    v[0] += push * n0 - k * s0
    v[1] += push * n1 - k * s1
    v[2] += push * n2 - k * s2
    turn = c[6] * k
    w[0] += turn * (n1 * s2 - n2 * s1)
    w[1] += turn * (n2 * s0 - n0 * s2)
    w[2] += turn * (n0 * s1 - n1 * s0)
