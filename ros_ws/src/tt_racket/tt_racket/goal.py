"""What to ask of the return when nobody asks: the dissertation's own goals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from tt_core.errors import check_range
from tt_core.states import Array, ReturnGoal


@dataclass(frozen=True)
class GoalParams:
    """Place and time of Table 4.5(b); spin answered by its kind."""

    landing_x: float = 2.055  # m, Table 4.5(b)
    landing_y: float = 0.7625  # m, the middle
    flight_time: float = 0.6  # s, Table 4.5(b), back spin
    back_spin_y: float = -125.66  # rad/s, Table 4.5(b), answer to back spin
    top_spin_y: float = 104.72  # rad/s, Table 4.5(b), answer to topspin
    side_spin_z: float = 100.0  # rad/s, Table 4.2(b) case 3, answer to side spin, against it

    def __post_init__(self) -> None:
        check_range("landing_x", self.landing_x, 1.37, 2.74)
        check_range("landing_y", self.landing_y, 0.0, 1.525)
        check_range("flight_time", self.flight_time, 0.1, 2.0)


def default_goal(spin: Array, params: GoalParams) -> ReturnGoal:
    """The goal for an incoming ball of that spin (3,) rad/s: back spin answered by back spin, topspin by topspin, side by side."""
    spin_y, spin_z = (params.back_spin_y if spin[1] > 0.0 else params.top_spin_y), 0.0
    if abs(spin[2]) > abs(spin[1]):
        spin_y, spin_z = 0.0, -np.sign(spin[2]) * params.side_spin_z
    return ReturnGoal(np.array([params.landing_x, params.landing_y]), params.flight_time, spin_y, spin_z)
