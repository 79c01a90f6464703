"""Measure how well models predict the landings of recorded launches.

A group is a set of equal launches. In each group, every second launch beginning with the first one is used for fits, and the landings of
the others are predicted. For each of these, position and velocity at the start are fitted with the model to the points of the first
SEEN_DURATION seconds. If its spin was not measured, it is the one that was fitted with the model to the first half of the group. The
landing is where the path predicted by `rollout` meets the table. The identified model is Liu's with the drag coefficient C_D fitted for
each group, because the dissertation fits each kind of spin separately.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from tt_core.arrays import Array
from tt_core.flight import Aerodynamics
from tt_core.physics import Physics
from tt_core.states import BallState

from .identify import Predictor, identify
from .landings import landing
from .recordings import Flight
from .rollout import StopRule, rollout

SEEN_DURATION = 0.2  # s, duration of the first part of a launch from which its landing is predicted
FEWEST_SEEN = 10  # least number of points in this part

COMPARED_MODELS = {
    "gravity only": Physics(air=Aerodynamics.gravity_only()),
    "liu as printed": Physics.liu(),
    "measured as printed": Physics.measured(),
    "identified": Physics.liu(),
}


def predicted_landing_error(flight: Flight, physics: Physics, spin: Array, seen: float = SEEN_DURATION) -> tuple[float, float] | None:
    """Predict the landing of a recorded flight from its first points, and compare it with the recorded landing.

    Args:
        flight: The recorded points of the ball.
        physics: Models of air and table.
        spin: (3,) rad/s in `table`, spin at the start.
        seen: s, duration from the start in which points are used.

    Returns:
        Distance in m and absolute time difference in s between the predicted and the recorded landing. None if no landing was recorded, if
        it was within the first `seen` seconds, or if there are fewer than FEWEST_SEEN points in these.
    """
    true = landing(flight)
    points = int(np.searchsorted(flight.times - flight.times[0], seen))
    if true is None or points < FEWEST_SEEN or flight.times[points - 1] > true.time:
        return None
    state = Predictor(physics).start(flight, spin, points)
    path = rollout(BallState.from_vector(flight.times[0], state), physics, StopRule.at_landing())
    return float(np.linalg.norm(path.end.position[:2] - true.place)), abs(float(path.end.time - true.time))


def validate(flights: Sequence[Flight]) -> dict[tuple[str, str], Array]:
    """Return the errors of the predicted landings for every group of flights and every model of COMPARED_MODELS.

    Args:
        flights: Recorded flights. In each group, every second one is used for fits only.

    Returns:
        For each pair of group and model name: (k, 2) distances in m and time differences in s of the launches that were not used for fits.
    """
    errors = {}
    for group in sorted({flight.group for flight in flights}):
        half = [flight for flight in flights if flight.group == group]
        for name, physics in COMPARED_MODELS.items():
            names = ["air.drag"] if name == "identified" else []
            spin_matters = name != "gravity only"
            found = identify(half[::2], physics, names) if spin_matters else None
            spins = [found.spin(flight) if found else np.zeros(3) for flight in half[1::2]]
            used = found.physics if found else physics
            pairs = (predicted_landing_error(flight, used, spin) for flight, spin in zip(half[1::2], spins, strict=True))
            errors[group, name] = np.array([pair for pair in pairs if pair]).reshape(-1, 2)
    return errors
