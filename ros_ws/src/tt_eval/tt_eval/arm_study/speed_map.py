"""Racket speeds that an arm reaches in its hit window, and the joints that limit them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from tt_arm.model import ArmModel
from tt_arm.reach import Reach, ReachParams, reach
from tt_core.hit_windows import HitWindow
from tt_core.states import Array, RacketState

MAP_COLUMNS, MAP_ROWS = 9, 6  # points of the map across the table and upwards
FASTEST_TRIED = 16.0  # m/s, upper end of the search
BISECTIONS = 7  # number of bisections of the speed
UPWARDS = 0.6  # upward over forward velocity of the racket, as in usual returns


@dataclass(frozen=True, eq=False)
class SpeedMap:
    """Racket speeds that an arm reaches, over the plane x = const in the middle of the hit window.

    Attributes:
        y: (MAP_COLUMNS,) m in `table`.
        z: (MAP_ROWS,) m in `table`.
        speed: (MAP_ROWS, MAP_COLUMNS) m/s, of a racket that moves forwards and upwards with its face forwards; 0 out of reach.
        bounding: For each joint, share of the points within reach where this joint is nearest to its speed limit.
    """

    y: Array
    z: Array
    speed: Array
    bounding: dict[str, float]


def speed_map(model: ArmModel, window: HitWindow, command_timeout: float) -> SpeedMap:
    """Compute the racket speeds that an arm reaches, by bisection.

    The postures leave room to brake after the drives have held a command.

    Args:
        model: The arm.
        window: Its hit window.
        command_timeout: s, for which the drives hold a command.
    """
    y, z = np.linspace(window.y_low, window.y_high, MAP_COLUMNS), np.linspace(window.z_low, window.z_high, MAP_ROWS)
    speeds, bounding, x = np.zeros((MAP_ROWS, MAP_COLUMNS)), list[int](), 0.5 * (window.x_low + window.x_high)
    params = ReachParams(swing_time=1.0, command_timeout=command_timeout)
    for row, height in enumerate(z):
        for column, side in enumerate(y):
            found = _fastest(model, np.array([x, side, height]), params)
            if found is not None:
                speeds[row, column], posture = found
                bounding.append(int(np.argmax(np.abs(posture.qdot) / model.speed_limits)))
    shares = {name: float(np.mean(np.array(bounding) == i)) for i, name in enumerate(model.names)} if bounding else {}
    return SpeedMap(y, z, speeds, shares)


def _fastest(model: ArmModel, place: Array, params: ReachParams) -> tuple[float, Reach] | None:
    """Return the highest racket speed (m/s) at a position (3,) m and its posture; None if the position is out of reach."""
    low, high, best = 0.0, FASTEST_TRIED, None
    way = np.array([1.0, 0.0, UPWARDS]) / np.hypot(1.0, UPWARDS)
    for speed in (0.0, *[None] * BISECTIONS):
        tried = 0.5 * (low + high) if speed is None else speed
        found = reach(model, RacketState(1.0, place, tried * way, 0.0, 0.5 * np.pi), model.waiting, params)
        if found.reason is None:
            low, best = tried, found
        elif speed is not None:
            return None
        else:
            high = tried
    return None if best is None else (low, best)
