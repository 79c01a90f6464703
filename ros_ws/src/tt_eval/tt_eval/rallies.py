"""Shots of real play, from the recorded states of data/deepmind (CC-BY 4.0, (c) 2025 Google LLC)."""

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
        file: The file; None when no folder of data is named.
    """

    def __init__(self, file: Path | None, why: str) -> None:
        """Keep the file."""
        super().__init__(f"{file} holds no shots: {why}" if file else why)
        self.file = file


def load(file: Path) -> list[BallState]:
    """Read all shots of a file, each at time 0 and turned so that it flies to -x.

    The file has its origin at the middle of the table's surface, x across, y along, z up: in `table`, x = 1.37 + Y and y = 0.7625 - X.
    Shots in the other direction are turned by half a turn about z.

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
    """Return whether an arm could be asked to return a ball: it bounces once, on the robot's half, and passes through the hit window.

    Args:
        ball: At the shot.
        physics: Of the ball.
        window: Where the arm hits.
    """
    path = rollout(ball, physics, StopRule.at_x(path_end(window.x_low)))
    return bool(hit_points(path, window)) and path.bounces[0].position[0] < TABLE_LENGTH / 2


@functools.cache
def shots(window: InterceptParams) -> tuple[BallState, ...]:
    """Return the shots of deepmind/rallies.json in the folder TT_DATA_DIR that are within reach.

    Args:
        window: Where the arm hits.

    Raises:
        NoShots: The environment variable is not set, or the file cannot be read.
    """
    folder = os.environ.get("TT_DATA_DIR")
    if not folder:
        raise NoShots(None, "TT_DATA_DIR names no folder with deepmind/rallies.json")
    physics = Physics.measured()
    return tuple(ball for ball in load(Path(folder) / "deepmind" / "rallies.json") if within_reach(ball, physics, window))
