"""What became of one ball, from the contacts of the true world."""

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

from .true_ball import Contact

BEHIND = -1.5  # m in x: past the arm
AFTER_LANDING = 0.1  # s that a returned ball is followed on
NODE = 0.04  # s


@njit(cache=True)
def places(ball: Array, times: Array, air: Array) -> Array:
    """(n, 3) m, of the ball (9,) in free flight at times (n,) s after it, rising: cubic between states NODE s apart, to 1e-5 m."""
    out, work, start, end, last = np.empty((len(times), 3)), np.empty((8, 3)), ball.copy(), ball.copy(), 0.0
    model = air_coefficients(air)
    for i in range(len(times)):
        while times[i] > last:
            start[:] = end
            fly_into(start, NODE, model, NODE, end, work)
            last += NODE
        u = 1.0 - (last - times[i]) / NODE
        for k in range(3):
            out[i, k] = hermite(start[k], start[3 + k], end[k], end[3 + k], NODE, u)
    return out


@dataclass
class Outcome:
    """launched: the ball at time and place of the launch. contacts: all so far, in order of time."""

    launched: BallState
    contacts: list[Contact] = field(default_factory=list)

    @property
    def _struck(self) -> int | None:
        """Which contact is with the racket."""
        return next((i for i, c in enumerate(self.contacts) if c.surface == "racket"), None)

    @property
    def hit(self) -> Contact | None:
        """The contact with the racket."""
        return None if (i := self._struck) is None else self.contacts[i]

    @property
    def landing(self) -> Contact | None:
        """What the ball met first after the hit; a net that it got over does not count."""
        return None if (i := self._struck) is None else next((c for c in self.contacts[i + 1 :] if c.surface != "net"), None)

    @property
    def result(self) -> str:
        """What it is as far as the contacts go: missed until hit, then flying until it meets something."""
        i = self._struck
        if i is None:
            return "missed"
        before, after = self.contacts[:i], self.contacts[i + 1 :]
        if sum(c.surface == "table" and c.before.position[0] < NET_X for c in before) > 1:
            return "double bounce"
        landing, net = self.landing, any(c.surface == "net" for c in after)
        if landing is not None and landing.surface == "table" and landing.before.position[0] > NET_X:
            return "returned"
        if landing is None or net:
            return "net" if net else "flying"
        return {"table": "own half", "racket": "second hit"}.get(landing.surface, "off the table")

    def followed_until(self, longest: float) -> float:
        """s, when nothing more of interest happens, as far as contacts tell; `longest` at most."""
        if (landing := self.landing) is not None:
            longest = min(longest, landing.before.time + AFTER_LANDING)
        floor = next((c.before.time for c in self.contacts if c.surface == "floor"), longest)
        return min(longest, floor)

    def places(self, times: Array, air: Array) -> Array:
        """(n, 3) m, of the ball at times (n,) s, rising, not before the launch. air: coefficients."""
        balls = [self.launched, *(contact.after for contact in self.contacts)]
        cuts = np.searchsorted(times, [*(ball.time for ball in balls), np.inf])
        parts = [places(ball.vector, times[a:b] - ball.time, air) for ball, a, b in zip(balls, cuts, cuts[1:], strict=False)]
        return np.concatenate(parts)

    def told(self) -> dict[str, Any]:
        """All of it as text, balls as JSON lists [time, position, velocity, spin], null for what did not happen."""
        hit, landing = self.hit, self.landing
        states = {
            "launched": self.launched,
            "hit": hit.before if hit else None,
            "after_hit": hit.after if hit else None,
            "landing": landing.before if landing else None,
        }
        rows = {name: json.dumps([ball.time, *ball.vector.tolist()] if ball else None) for name, ball in states.items()}
        return {"result": self.result, **rows, "offset": json.dumps(hit.offset if hit else None)}

    def over(self, ball: BallState | None, time: float) -> bool:
        """Whether nothing more of interest happens to the ball, which is None when it is gone."""
        if ball is None or (self.hit is None and ball.position[0] < BEHIND):
            return True
        return self.landing is not None and time > self.landing.before.time + AFTER_LANDING
