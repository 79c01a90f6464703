"""The two high speed cameras of the dissertation, as they stand by default, in frame `table`."""

from __future__ import annotations

import math

import numpy as np

from .camera import Camera

FRAME_RATE = 900.0  # 1/s, dissertation Section 2.1
EXPOSURE = 200e-6  # s; not printed in the dissertation; spin stays sharp up to here
VIEW_CENTRE = (2.52, 0.7625, 0.365)  # m, just after the launcher at (2.62, 0.7625, 0.34)
DISTANCE = 1.0  # m from the view centre: the ball is 70 pixels wide
APART = math.radians(45.0)  # between the two lines of sight
PIXEL_SIZE = 20e-6  # m, dissertation Table A.6
ABOVE = math.radians(20.0)  # elevation of the plane of the two lines of sight


def high_speed_pair() -> tuple[Camera, Camera]:
    """(left, right): both on the side y < 0.7625, seeing 13 cm of the flight, left the one nearer to the net."""
    middle = math.cos(APART / 2) * np.array([0.0, -math.cos(ABOVE), math.sin(ABOVE)])
    aside = math.sin(APART / 2) * np.array([1.0, 0.0, 0.0])
    left, right = (
        Camera.looking_at(
            np.array(VIEW_CENTRE) + DISTANCE * (middle + side * aside),
            VIEW_CENTRE,
            focal_length=35e-3,  # m, dissertation Table A.4
            pixel_size=PIXEL_SIZE,
            width=232,  # dissertation Section 2.1
            height=232,
        )
        for side in (-1.0, 1.0)
    )
    return left, right
