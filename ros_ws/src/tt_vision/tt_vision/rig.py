"""The cameras and their default poses in the frame `table`: two high speed cameras at the launcher, and two cameras with a wide view.

Their data are, where printed, those of the Nagoya dissertation "Racket Control and Spinning Ball Measurement for Table Tennis Robot".
"""

from __future__ import annotations

import math

import numpy as np

from .camera import Camera

SIDES = ("left", "right")  # names of the high speed cameras, in this order everywhere
WIDE_SIDES = ("wide_left", "wide_right")  # names of the wide cameras, in this order everywhere

FRAME_RATE = 900.0  # 1/s, dissertation Section 2.1
EXPOSURE = 200e-6  # s; the dissertation does not print it; up to this exposure the measured spin stays accurate
VIEW_CENTRE = (2.52, 0.7625, 0.365)  # m, just after the launcher at (2.62, 0.7625, 0.34)
DISTANCE = 1.0  # m from the view centre: the ball is 70 pixels wide
SIGHT_ANGLE = math.radians(45.0)  # rad between the two lines of sight
PIXEL_SIZE = 20e-6  # m, dissertation Table A.6
ELEVATION = math.radians(20.0)  # rad, elevation of the plane of the two lines of sight

WIDE_RATE = 150.0  # 1/s, dissertation Table A.7
WIDE_NOISE = 0.15  # pixels, standard deviation of each coordinate of the ball; that of the centroid of a ball 7 pixels wide is 0.1
CLOCK_SPREAD = 3e-4  # s, standard deviation of the difference between the clocks of the two pairs; in 0.2 ms a ball moves 1 mm
WIDE_BIAS = 0.2  # pixels, constant error: a camera that has turned by 2e-4 rad since its calibration is 0.23 pixels off
WIDE_CENTRE = (1.28, 0.7625, 0.2)  # m, the point in the middle of both images
WIDE_DISTANCE = 7.0  # m from that point: from there each camera sees both table ends and 0.4 m behind each; a pixel is 6 mm at the ball
WIDE_SIGHT_ANGLE = math.radians(60.0)  # rad between the two lines of sight
WIDE_ELEVATION = math.radians(25.0)  # rad, elevation of both


def high_speed_pair() -> tuple[Camera, Camera]:
    """Return the two high speed cameras (left, right) at their default poses.

    Both stand on the side y < 0.7625 m and see 13 cm of the flight, just after the launcher. The left one is nearer to the net.
    """
    middle = math.cos(SIGHT_ANGLE / 2) * np.array([0.0, -math.cos(ELEVATION), math.sin(ELEVATION)])
    aside = math.sin(SIGHT_ANGLE / 2) * np.array([1.0, 0.0, 0.0])
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


def wide_pair() -> tuple[Camera, Camera]:
    """Return the two wide cameras (wide_left, wide_right) at their default poses.

    Both stand on the side y < 0 and see the ball over the whole table and 0.4 m behind each end. The left one is nearer to the robot. The
    dissertation does not print where its wide cameras stood, so these poses are the project's own.
    """
    flat, high = math.cos(WIDE_ELEVATION), math.sin(WIDE_ELEVATION)
    aside, back = flat * math.sin(WIDE_SIGHT_ANGLE / 2), flat * math.cos(WIDE_SIGHT_ANGLE / 2)
    left, right = (
        Camera.looking_at(
            np.array(WIDE_CENTRE) + WIDE_DISTANCE * np.array([side * aside, -back, high]),
            WIDE_CENTRE,
            focal_length=8.3e-3,  # m, dissertation Table A.8
            pixel_size=7.4e-6,  # m, dissertation Table A.7
            width=640,
            height=480,
        )
        for side in (-1.0, 1.0)
    )
    return left, right
