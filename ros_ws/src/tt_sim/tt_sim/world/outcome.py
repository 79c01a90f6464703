"""Result of a launched ball, from its contacts with table, net, floor and racket."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import njit
from tt_core.constants import NET_X
from tt_core.flight import air_coefficients, fly_into
from tt_core.interpolate import hermite
from tt_core.states import Array, BallState
from tt_core.text_enum import TextEnum

from .true_ball import Contact, Surface

PASSED_X = -1.5  # m, x in `table` below which a ball has passed the arm
AFTER_LANDING = 0.1  # s, for which a ball is simulated after its landing
NODE = 0.04  # s between two integrated states; cubic interpolation between them is off by 1e-5 m


@njit(cache=True)
def free_flight_positions(ball: Array, times: Array, air: Array) -> Array:
    """Return the positions of a ball in free flight at many times, by cubic interpolation between states NODE s apart.

    Args:
        ball: (9,) position (m), velocity (m/s), spin (rad/s).
        times: (n,) s after this state, increasing.
        air: (8,) coefficients of the air, `Aerodynamics.coefficients`.

    Returns:
        (n, 3) m in `table`.
    """
    out, work, start, end, last = np.empty((len(times), 3)), np.empty((8, 3)), ball.copy(), ball.copy(), 0.0
    start_position, start_velocity, end_position, end_velocity = start[:3], start[3:6], end[:3], end[3:6]
    model = air_coefficients(air)
    for i in range(len(times)):
        while times[i] > last:
            start[:] = end
            fly_into(start, NODE, model, NODE, end, work)
            last += NODE
        u = 1.0 - (last - times[i]) / NODE
        for k in range(3):
            out[i, k] = hermite(start_position[k], start_velocity[k], end_position[k], end_velocity[k], NODE, u)
    return out


class Result(TextEnum):
    """Results of a launched ball."""

    MISSED = "missed"  # the racket has not touched it
    DOUBLE_BOUNCE = "double bounce"  # it touched the robot's half more than once before the racket
    FLYING = "flying"  # nothing has stopped it since the racket
    NET = "net"  # it touched the net after the racket and did not land on the opponent's half
    OWN_HALF = "own half"  # it landed on the robot's half
    SECOND_HIT = "second hit"  # it touched the racket again before it landed
    OFF_TABLE = "off the table"  # it fell to the floor
    RETURNED = "returned"  # it landed on the opponent's half


@dataclass
class Outcome:
    """Record of the flight of one launched ball so far, and its result.

    Attributes:
        launched: The ball at its launch.
        contacts: All contacts so far, in the order of time.
    """

    launched: BallState
    contacts: list[Contact] = field(default_factory=list)

    @property
    def _struck(self) -> int | None:
        """Index of the first contact with the racket; None if there is none."""
        return next((i for i, c in enumerate(self.contacts) if c.surface is Surface.RACKET), None)

    @property
    def hit(self) -> Contact | None:
        """The first contact with the racket; None if there is none."""
        return None if (i := self._struck) is None else self.contacts[i]

    @property
    def landing(self) -> Contact | None:
        """The first contact after the hit that is not with the net: the end of the return flight. None if there is none."""
        return None if (i := self._struck) is None else next((c for c in self.contacts[i + 1 :] if c.surface is not Surface.NET), None)

    @property
    def result(self) -> Result:
        """The result according to the contacts so far: MISSED before the racket hits the ball, then FLYING until the ball lands."""
        i = self._struck
        if i is None:
            return Result.MISSED
        before, after = self.contacts[:i], self.contacts[i + 1 :]
        if sum(c.surface is Surface.TABLE and c.before.position[0] < NET_X for c in before) > 1:
            return Result.DOUBLE_BOUNCE
        landing, net = self.landing, any(c.surface is Surface.NET for c in after)
        if landing is not None and landing.surface is Surface.TABLE and landing.before.position[0] > NET_X:
            return Result.RETURNED
        if landing is None or net:
            return Result.NET if net else Result.FLYING
        return {Surface.TABLE: Result.OWN_HALF, Surface.RACKET: Result.SECOND_HIT}.get(landing.surface, Result.OFF_TABLE)

    def followed_until(self, longest: float) -> float:
        """Return the time (s) until which the flight is of interest, according to the contacts so far.

        It is AFTER_LANDING after the landing, the contact with the floor, or `longest` (s), whichever is first.
        """
        if (landing := self.landing) is not None:
            longest = min(longest, landing.before.time + AFTER_LANDING)
        floor = next((c.before.time for c in self.contacts if c.surface is Surface.FLOOR), longest)
        return min(longest, floor)

    def places(self, times: Array, air: Array) -> Array:
        """Return the positions of the ball at many times.

        Args:
            times: (n,) s, increasing, not before the launch.
            air: (8,) coefficients of the air, `Aerodynamics.coefficients`.

        Returns:
            (n, 3) m in `table`.
        """
        balls = [self.launched, *(contact.after for contact in self.contacts)]
        cuts = np.searchsorted(times, [*(ball.time for ball in balls), np.inf])
        parts = [free_flight_positions(ball.vector, times[a:b] - ball.time, air) for ball, a, b in zip(balls, cuts, cuts[1:], strict=False)]
        return np.concatenate(parts)

    def to_text(self) -> dict[str, Any]:
        """Return result, states and offset of the hit as text, by name, for a diagnostic status.

        States are JSON lists of time, position, velocity and spin in SI units. The text is null for what did not happen.
        """
        hit, landing = self.hit, self.landing
        states = {
            "launched": self.launched,
            "hit": hit.before if hit else None,
            "after_hit": hit.after if hit else None,
            "landing": landing.before if landing else None,
        }
        rows = {name: json.dumps([ball.time, *ball.vector.tolist()] if ball else None) for name, ball in states.items()}
        return {"result": self.result.value, **rows, "offset": json.dumps(hit.offset if hit else None)}

    def over(self, ball: BallState | None, time: float) -> bool:
        """Tell whether the ball needs no further simulation.

        Args:
            ball: The ball now; None if it lies on the floor or the table.
            time: s, now.
        """
        if ball is None or (self.hit is None and ball.position[0] < PASSED_X):
            return True
        return self.landing is not None and time > self.landing.before.time + AFTER_LANDING
