"""Compute the data of the 3D scene in which the page replays a ball: ball, arm and racket at equal steps of time."""

from __future__ import annotations

from typing import Any

import numpy as np
from tt_core.constants import NET_HEIGHT, NET_OVERHANG, NET_X, RACKET_RADIUS, TABLE_LENGTH, TABLE_WIDTH
from tt_core.states import Array

from .arm_pose import ArmPose
from .run_record import BallRecord

REPLAY_STEP = 0.02  # s from one step of the replay to the next
SCENE_TIME = 4.0  # s, longest replay of a ball
DRAWN_RIM_POINTS = 24  # points of the racket's rim
DIGITS = 3  # decimals of lengths in m on the page


def rally_scene(ball: BallRecord, arm: ArmPose | None) -> dict[str, Any]:
    """Return the data of the 3D scene of one ball, in lists that the page can read. Positions are in the frame `table`, m.

    Args:
        ball: Record of the ball.
        arm: The arm of the recording; None to show no arm.

    Returns:
        A dictionary with these keys. `table`: length and width of the table, and x, height and overhang of the net, m. `step`: time from
        one step to the next, s; the first step is at the start of the record. `true`, `predicted`: the true and the predicted path, (n, 3).
        `asked`, `landed`: landing that was asked for and reached, (3,), or None. `ball`: for each step, the position of the ball, (3,),
        or None. `arm`: for each step, the line from joint to joint to the racket, (n, 3). `racket`: for each step, the rim of the racket,
        (DRAWN_RIM_POINTS, 3). `arm` and `racket` are empty without an arm.
    """
    times = np.arange(ball.start, min(ball.end, ball.start + SCENE_TIME), REPLAY_STEP)
    scene: dict[str, Any] = {
        "table": [TABLE_LENGTH, TABLE_WIDTH, NET_X, NET_HEIGHT, NET_OVERHANG],
        "step": REPLAY_STEP,
        "true": _rounded(ball.truth[::4, 1:]),
        "predicted": _rounded(ball.path.positions) if ball.path is not None else [],
        "asked": [*ball.goal.landing.tolist(), 0.0] if ball.goal is not None else None,
        "landed": None,
        "ball": _ball_at(ball, times),
        "arm": [],
        "racket": [],
    }
    if ball.metrics is not None and ball.metrics.landing_reached is not None:
        scene["landed"] = [*ball.metrics.landing_reached, 0.0]
    if arm is not None and len(ball.joints):
        count = (ball.joints.shape[1] - 1) // 2
        for time in times:
            q = np.array([np.interp(time, ball.joints[:, 0], ball.joints[:, 1 + k]) for k in range(count)])
            line, middle, rotation = arm.at(q)
            scene["arm"].append(_rounded(line))
            scene["racket"].append(_rounded(_rim(middle, rotation)))
    return scene


def _ball_at(ball: BallRecord, times: Array) -> list[list[float] | None]:
    """Return the position of the ball at each time (s): that of the true ball if recorded, else of the predicted one; None if not known."""
    rows = ball.truth
    if not len(rows) and ball.path is not None:
        rows = np.column_stack([ball.path.times, ball.path.positions])
    if not len(rows):
        return [None] * len(times)
    places = np.column_stack([np.interp(times, rows[:, 0], rows[:, k]) for k in (1, 2, 3)])
    return [place if rows[0, 0] <= time <= rows[-1, 0] else None for time, place in zip(times, _rounded(places), strict=True)]


def _rim(middle: Array, rotation: Array) -> Array:
    angles = np.linspace(0.0, 2.0 * np.pi, DRAWN_RIM_POINTS, endpoint=False)
    circle = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(DRAWN_RIM_POINTS)])
    return middle + RACKET_RADIUS * circle @ rotation.T


def _rounded(points: Array) -> list[Any]:
    rounded: list[Any] = np.round(points, DIGITS).tolist()
    return rounded
