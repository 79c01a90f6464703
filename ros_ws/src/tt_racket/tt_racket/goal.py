"""Default goals of a return, which are used while no goal is asked for: those of the dissertation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from tt_core.arrays import Array
from tt_core.params import check, param
from tt_core.states import ReturnGoal


@dataclass(frozen=True)
class GoalParams:
    """Default goal of a return: landing place and flight time of the dissertation's Table 4.5(b), and one spin per kind of ball.

    The spins (rad/s) are those after the hit; `default_goal` chooses one of them.
    """

    landing_x: float = param(2.055, "m", "x of the default landing place, Table 4.5(b)", low=1.37, high=2.74, dynamic=True)
    landing_y: float = param(0.7625, "m", "y of the default landing place, the middle of the table", low=0.0, high=1.525, dynamic=True)
    flight_time: float = param(0.6, "s", "default time from racket to landing, Table 4.5(b), back spin", low=0.1, high=2.0, dynamic=True)
    back_spin_y: float = param(
        -125.66, "rad/s", "spin about y with which back spin is returned, Table 4.5(b)", low=-2000.0, high=2000.0, dynamic=True
    )
    top_spin_y: float = param(
        104.72, "rad/s", "spin about y with which topspin is returned, Table 4.5(b)", low=-2000.0, high=2000.0, dynamic=True
    )
    side_spin_z: float = param(
        100.0,
        "rad/s",
        "spin about z, against the ball's own, with which side spin is returned, Table 4.2(b) case 3",
        low=-2000.0,
        high=2000.0,
        dynamic=True,
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


def default_goal(spin: Array, params: GoalParams) -> ReturnGoal:
    """Return the default goal for an incoming ball: back spin is returned with back spin, topspin with topspin, side spin with side spin.

    Args:
        spin: (3,) rad/s in `table`, of the incoming ball. It counts as side spin if |w_z| > |w_y|, else as back spin if w_y > 0.
        params: Landing place, flight time and the spin for each kind.
    """
    spin_y, spin_z = (params.back_spin_y if spin[1] > 0.0 else params.top_spin_y), 0.0
    if abs(spin[2]) > abs(spin[1]):
        spin_y, spin_z = 0.0, -np.sign(spin[2]) * params.side_spin_z
    return ReturnGoal(np.array([params.landing_x, params.landing_y]), params.flight_time, spin_y, spin_z)
