"""Shots of real play, from the recorded states in data/deepmind (CC-BY 4.0, (c) 2025 Google LLC)."""

from __future__ import annotations

import functools
import json
import os
from pathlib import Path

import numpy as np
from tt_core.constants import TABLE_LENGTH, TABLE_WIDTH
from tt_core.errors import TtError
from tt_core.hit_windows import path_end
from tt_core.physics import Physics
from tt_core.states import BallState
from tt_predict.rollout import StopRule, rollout
from tt_racket.intercept import InterceptParams, hit_points


class NoShots(TtError):
    """Recorded shots that cannot be read.

    Attributes:
        file: The file; None if no folder of data is set.
    """

    def __init__(self, file: Path | None, why: str) -> None:
        """Store the file.

        Args:
            file: The file; None if no folder of data is set.
            why: Reason, for the message.
        """
        super().__init__(f"{file} holds no shots: {why}" if file else why)
        self.file = file


def load_rallies(file: Path) -> list[BallState]:
    """Read all shots of a file. Each has time 0 and flies to -x of `table`.

    In the file the origin is the middle of the table's surface, x is across the table, y along it, and z up: x of `table` is 1.37 + Y and y
    is 0.7625 - X. Shots in the other direction are rotated by half a turn about z.

    Raises:
        NoShots: The file cannot be read.
    """
    try:
        rows = json.loads(file.read_text())
        table = np.array([[row[k] for k in _KEYS] for row in rows], dtype=float)
    except (OSError, ValueError, KeyError) as error:
        raise NoShots(file, str(error)) from error
    x, y, z = table.reshape(-1, 3, 3).transpose(2, 0, 1)
    states = np.stack([y, -x, z], axis=-1)  # (n, 3 of position, velocity, spin, 3)
    states[states[:, 1, 0] > 0.0, :, :2] *= -1.0
    states[:, 0] += [TABLE_LENGTH / 2, TABLE_WIDTH / 2, 0.0]
    return [BallState(0.0, *state) for state in states]


_KEYS = [f"{what}_{axis}" for what in ("pos", "vel", "w_vel") for axis in "xyz"]


def within_reach(ball: BallState, physics: Physics, window: InterceptParams) -> bool:
    """Tell whether an arm can be expected to return a ball: it bounces once on the robot's half, and passes through the hit window.

    Args:
        ball: The ball at the shot.
        physics: Physics of the ball.
        window: Region in which the arm hits balls.
    """
    path = rollout(ball, physics, StopRule.at_x(path_end(window.x_low)))
    return bool(hit_points(path, window)) and path.bounces[0].position[0] < TABLE_LENGTH / 2


@functools.cache
def reachable_shots(window: InterceptParams) -> tuple[BallState, ...]:
    """Return the shots in deepmind/rallies.json of the folder TT_DATA_DIR (an environment variable) that are within reach.

    Args:
        window: Region in which the arm hits balls.

    Raises:
        NoShots: The environment variable is not set, or the file cannot be read.
    """
    folder = os.environ.get("TT_DATA_DIR")
    if not folder:
        raise NoShots(None, "TT_DATA_DIR names no folder with deepmind/rallies.json")
    physics = Physics.measured()
    return tuple(ball for ball in load_rallies(Path(folder) / "deepmind" / "rallies.json") if within_reach(ball, physics, window))
