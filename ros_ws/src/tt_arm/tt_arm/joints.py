"""What a set of joints is: their motion at one instant."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from tt_core.errors import check_array, check_range
from tt_core.states import Array


@dataclass(frozen=True, slots=True, eq=False)
class Joints:
    """The joints at one instant: time s, q (7,) rad, qdot (7,) rad/s, and qddot (7,) rad/s^2 where it is known."""

    time: float
    q: Array
    qdot: Array
    qddot: Array = field(default_factory=lambda: np.zeros(7))

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", check_range("time", self.time, -math.inf, math.inf))
        for name in ("q", "qdot", "qddot"):
            object.__setattr__(self, name, check_array(name, getattr(self, name), (7,)))
