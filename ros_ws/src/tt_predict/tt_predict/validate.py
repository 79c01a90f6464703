"""How well models predict the landings of recorded launches.

Protocol: Of each group every second launch, from the first on, is used to fit; the others are predicted. The start of each of these is
fitted, with the model, to its points of the first SEEN seconds. Its spin, if it was not measured, is the one that the model found for the
group on the fitted half. Its landing is where rollout meets the table. The identified model is liu's with C_D fitted for each group,
because the dissertation fits each kind of spin by itself.
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

SEEN = 0.2  # s of a launch from which its landing is predicted
FEWEST_SEEN = 10  # points to start from

MODELS = {
    "gravity only": Physics(air=Aerodynamics.gravity_only()),
    "liu as printed": Physics.liu(),
    "measured as printed": Physics.measured(),
    "identified": Physics.liu(),
}


def landing_error(flight: Flight, physics: Physics, spin: Array, seen: float = SEEN) -> tuple[float, float] | None:
    """Predict the landing of a flight from its first points.

    Args:
        flight: As recorded.
        physics: Models of air and table.
        spin: (3,) rad/s at the start.
        seen: s, from the start, of the points that are used.

    Returns:
        Distance in m and time in s between the predicted and the recorded landing; None if no landing was recorded, or there are less than
        FEWEST_SEEN points before it.
    """
    true = landing(flight)
    points = int(np.searchsorted(flight.times - flight.times[0], seen))
    if true is None or points < FEWEST_SEEN or flight.times[points - 1] > true.time:
        return None
    state = Predictor(physics).start(flight, spin, points)
    path = rollout(BallState.from_vector(flight.times[0], state), physics, StopRule.at_landing())
    return float(np.linalg.norm(path.end.position[:2] - true.place)), abs(float(path.end.time - true.time))


def validate(flights: Sequence[Flight]) -> dict[tuple[str, str], Array]:
    """Return the landing errors (k, 2), in m and s, of the launches that were not fitted, by group and name of the model."""
    errors = {}
    for group in sorted({flight.group for flight in flights}):
        half = [flight for flight in flights if flight.group == group]
        for name, physics in MODELS.items():
            names = ["air.drag"] if name == "identified" else []
            spin_matters = name != "gravity only"
            found = identify(half[::2], physics, names) if spin_matters else None
            spins = [found.spin(flight) if found else np.zeros(3) for flight in half[1::2]]
            used = found.physics if found else physics
            pairs = (landing_error(flight, used, spin) for flight, spin in zip(half[1::2], spins, strict=True))
            errors[group, name] = np.array([pair for pair in pairs if pair]).reshape(-1, 2)
    return errors
