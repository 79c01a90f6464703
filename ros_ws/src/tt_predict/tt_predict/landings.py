"""Find place and time at which a recorded ball met the table."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from tt_core.arrays import Array
from tt_core.constants import BALL_RADIUS

from .recordings import Flight

NEAR_TABLE = 0.1  # m, largest height of the lowest recorded point near a bounce
LONGEST_EXTRAPOLATION = 0.03  # s, longest time after the lowest recorded point for which a landing is extrapolated


class Landing(NamedTuple):
    """Contact of a ball with the table: time in s, and place (2,), x and y of the ball's centre in m in `table`."""

    time: float
    place: Array


def landing(flight: Flight, contact_height: float = BALL_RADIUS) -> Landing | None:
    """Find place and time at which a recorded ball bounced for the first time.

    A parabola is fitted to the last 10 points before the lowest recorded point, and one to the 8 points after it. The bounce is where both
    parabolas meet. If there are fewer than 6 points after the lowest one, the bounce is where the first parabola comes down to
    `contact_height`, at most LONGEST_EXTRAPOLATION seconds after the lowest point.

    Args:
        flight: The recorded points of the ball.
        contact_height: m, height of the ball's centre above the table at the bounce.

    Returns:
        The landing, or None if no bounce is found in the points.
    """
    z = flight.positions
    low = [i for i in range(3, len(z)) if z[i, 2] < NEAR_TABLE and z[i, 2] == z[i - 3 : i + 4, 2].min()]
    if not low:
        return None
    lowest = low[0]
    t = flight.times - flight.times[lowest]
    after = slice(lowest + 1, lowest + 9)
    bounced = len(t[after]) >= 6
    before = slice(max(0, lowest - 10), lowest if bounced else lowest + 1)
    if len(t[before]) < 6:
        return None
    arc = np.polynomial.polynomial.polyfit(t[before], z[before], 2)
    other = np.polynomial.polynomial.polyfit(t[after], z[after, 2], 2) if bounced else np.array([contact_height, 0.0, 0.0])
    roots = np.roots((arc[:, 2] - other)[::-1])
    at = float(min(roots.real, key=abs))
    if np.abs(roots.imag).max() > 0.0 or not -0.02 < at < (0.02 if bounced else LONGEST_EXTRAPOLATION):
        return None
    place = np.array([np.polynomial.polynomial.polyval(at, arc[:, k]) for k in range(2)])
    return Landing(float(flight.times[lowest] + at), place)


def up_to_landing(flight: Flight) -> Flight:
    """Return the points of a flight before its first recorded bounce; all points if no bounce was recorded."""
    bounce = landing(flight)
    n = int(np.searchsorted(flight.times, bounce.time)) if bounce else len(flight.times)
    return Flight(flight.group, flight.times[:n], flight.positions[:n], flight.spin)
