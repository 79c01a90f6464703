"""Compiles every kernel once, so that no node compiles when a ball flies: python -m tt_bringup.warm."""

from __future__ import annotations

import numpy as np
from tt_core.flight import fly
from tt_core.physics import Physics
from tt_core.states import RacketState


def main() -> None:
    physics = Physics.liu()
    ball = np.array([2.6, 0.76, 0.3, -5.0, 0.1, 2.0, 10.0, -300.0, 20.0])
    fly(ball, 0.1, physics.air.coefficients)
    physics.air.acceleration(ball[3:6], ball[6:9])
    physics.table.after(np.array([-5.0, 0.0, -2.0]), ball[6:9])
    physics.racket.after(ball[3:6], ball[6:9], RacketState(0.0, [0, 0, 0], [1.0, 0.0, 1.0], 0.0, 1.0))


if __name__ == "__main__":
    main()
