"""Parameters of the tracker: its assumptions about balls, tables and measurements."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import chdtri
from tt_core.params import check, param
from tt_core.states import Array


@dataclass(frozen=True)
class TrackerParams:
    """Parameters of the tracker: its assumptions about balls, tables and measurements."""

    lag: float = param(
        0.4,
        "s",
        "age of the oldest measurements that are fitted anew; later ones are still taken in order of their stamps",
        low=0.02,
        high=2.0,
    )
    drag_spread: float = param(
        0.06, "", "standard deviation of the drag of one ball about that of `physics`, as a share", low=1e-3, high=1.0
    )
    lift_spread: float = param(
        0.10, "", "standard deviation of the lift of one ball about that of `physics`, as a share", low=1e-3, high=1.0
    )
    restitution_spread: float = param(0.02, "", "standard deviation of the restitution of the table, as a share", low=1e-4, high=0.5)
    friction_spread: float = param(0.06, "", "standard deviation of the friction of the table, as a share", low=1e-4, high=1.0)
    grip_spread: float = param(0.08, "", "standard deviation of the grip of the table, as a share", low=1e-4, high=1.0)
    speed_spread: float = param(
        15.0, "m/s", "standard deviation of each velocity component before anything is measured", low=1.0, high=100.0
    )
    spin_spread: float = param(
        400.0,
        "rad/s",
        "standard deviation of each spin component before anything is measured; match play: 265 rad/s in the median, 956 at most",
        low=1.0,
        high=2000.0,
    )
    spin_weight: float = param(
        0.3, "", "number of measured spin components that this standard deviation counts as much as", low=1e-3, high=1e6
    )
    spin_along: float = param(
        0.5,
        "",
        "standard deviation of the spin along the flight over that across it; recorded rallies have 0.5 to 0.6",
        low=0.01,
        high=10.0,
    )
    acceleration_noise: float = param(
        0.05, "m/s^2/sqrt(Hz)", "root of the power density of accelerations that no model knows", low=0.0, high=10.0
    )
    spin_noise: float = param(
        1.0, "rad/s^2/sqrt(Hz)", "root of the power density of changes of spin that no model knows", low=0.0, high=1e3
    )
    bounce_noise: float = param(
        1.0, "rad/s", "standard deviation of a change of spin at a bounce that no model knows", low=1e-3, high=100.0
    )
    camera_bias: float = param(
        0.0,
        "pixels",
        "standard deviation of a constant error of each camera's pixel coordinates, as of a turned camera",
        low=0.0,
        high=100.0,
    )
    clock_spread: float = param(
        0.0, "s", "standard deviation of the difference between the clocks of measured balls and of pixels", low=0.0, high=0.1
    )
    gate: float = param(1e-4, "", "probability at which a measurement is taken for that of something else", low=1e-12, high=0.1)
    known_position: float = param(0.1, "m", "standard deviation of the position below which a ball is known", low=1e-3, high=10.0)
    known_speed: float = param(2.0, "m/s", "standard deviation of the velocity below which a ball is known", low=1e-2, high=100.0)

    def __post_init__(self) -> None:
        """Raise an error for a value outside its range."""
        check(self)

    @cached_property
    def gates(self) -> Array:
        """Bounds (4,) above which the squared distance of a measurement from its prediction is taken as an outlier.

        The index is the number of coordinates of the measurement, 0 to 3. Distances are in standard deviations. A correct measurement
        exceeds its bound with the probability `gate` (chi-square distribution). The bound for no coordinate is infinite.
        """
        return np.array([np.inf, *(float(chdtri(n, self.gate)) for n in (1, 2, 3))])

    @cached_property
    def factor_spreads(self) -> Array:
        """Standard deviations (5,) of the logarithms of the factors on drag, lift, restitution, friction and grip, in this order."""
        return np.array([self.drag_spread, self.lift_spread, self.restitution_spread, self.friction_spread, self.grip_spread])
