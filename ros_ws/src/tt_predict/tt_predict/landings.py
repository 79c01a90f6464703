"""Where a recorded ball met the table."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from tt_core.arrays import Array
from tt_core.constants import BALL_RADIUS

from .recordings import Flight

NEAR_TABLE = 0.1  # m, height of the lowest point of an arc that ends on the table
BEYOND = 0.03  # s after the last point in which a landing is extrapolated


class Landing(NamedTuple):
    """Where and when a ball met the table: time in s, place (2,) in m."""

    time: float
    place: Array


def landing(flight: Flight, contact_height: float = BALL_RADIUS) -> Landing | None:
    """Find where and when a recorded ball bounced.

    The bounce is where the arcs before and after the lowest point meet. Without an arc after it, the bounce is where the arc before it
    comes to the contact height, at most BEYOND later. Arcs are parabolas through 10 and 8 points.

    Args:
        flight: As recorded.
        contact_height: m, of the ball's centre at the bounce.

    Returns:
        The landing, or None if no bounce was recorded.
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
    if np.abs(roots.imag).max() > 0.0 or not -0.02 < at < (0.02 if bounced else BEYOND):
        return None
    place = np.array([np.polynomial.polynomial.polyval(at, arc[:, k]) for k in range(2)])
    return Landing(float(flight.times[lowest] + at), place)


def up_to_landing(flight: Flight) -> Flight:
    """Return the flight up to its recorded bounce, or all of it if none was recorded."""
    bounce = landing(flight)
    n = int(np.searchsorted(flight.times, bounce.time)) if bounce else len(flight.times)
    return Flight(flight.group, flight.times[:n], flight.positions[:n], flight.spin)
