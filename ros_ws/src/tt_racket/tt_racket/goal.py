"""What to ask of the return when nobody asks: the dissertation's own goals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from tt_core.params import check, param
from tt_core.states import Array, ReturnGoal


@dataclass(frozen=True)
class GoalParams:
    """Place and time of Table 4.5(b); spin answered by its kind."""

    landing_x: float = param(2.055, "m", "Table 4.5(b)", low=1.37, high=2.74, dynamic=True)
    landing_y: float = param(0.7625, "m", "the middle", low=0.0, high=1.525, dynamic=True)
    flight_time: float = param(0.6, "s", "Table 4.5(b), back spin", low=0.1, high=2.0, dynamic=True)
    back_spin_y: float = param(-125.66, "rad/s", "Table 4.5(b), answer to back spin", dynamic=True)
    top_spin_y: float = param(104.72, "rad/s", "Table 4.5(b), answer to topspin", dynamic=True)
    side_spin_z: float = param(100.0, "rad/s", "Table 4.2(b) case 3, answer to side spin, against it", dynamic=True)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


def default_goal(spin: Array, params: GoalParams) -> ReturnGoal:
    """The goal for an incoming ball of that spin (3,) rad/s: back spin answered by back spin, topspin by topspin, side by side."""
    spin_y, spin_z = (params.back_spin_y if spin[1] > 0.0 else params.top_spin_y), 0.0
    if abs(spin[2]) > abs(spin[1]):
        spin_y, spin_z = 0.0, -np.sign(spin[2]) * params.side_spin_z
    return ReturnGoal(np.array([params.landing_x, params.landing_y]), params.flight_time, spin_y, spin_z)
