"""The cameras of the dissertation and where they stand by default, in `table`: two fast ones at the launcher, and two wide ones."""

from __future__ import annotations

import math

import numpy as np

from .camera import Camera

SIDES = ("left", "right")  # of the fast cameras, in this order everywhere
WIDE_SIDES = ("wide_left", "wide_right")  # of the wide cameras, in this order everywhere

FRAME_RATE = 900.0  # 1/s, dissertation Section 2.1
EXPOSURE = 200e-6  # s; not printed in the dissertation; spin stays sharp up to here
VIEW_CENTRE = (2.52, 0.7625, 0.365)  # m, just after the launcher at (2.62, 0.7625, 0.34)
DISTANCE = 1.0  # m from the view centre: the ball is 70 pixels wide
SIGHT_ANGLE = math.radians(45.0)  # rad between the two lines of sight
PIXEL_SIZE = 20e-6  # m, dissertation Table A.6
ELEVATION = math.radians(20.0)  # rad, elevation of the plane of the two lines of sight

WIDE_RATE = 150.0  # 1/s, dissertation Table A.7
WIDE_NOISE = 0.15  # pixels, standard deviation of each coordinate of the ball; of a centroid of 7 pixels 0.1
CLOCK_SPREAD = 3e-4  # s, by which the clocks of the two pairs differ; 0.2 ms are 1 mm of a ball
WIDE_BIAS = 0.2  # pixels, error that lasts: cameras turned by 2e-4 rad since they were calibrated are 0.23 pixels off
WIDE_CENTRE = (1.28, 0.7625, 0.2)  # m, in the middle of their images
WIDE_DISTANCE = 7.0  # m from there, as far as it takes to see from 0.4 m behind the robot's end to as far behind the other: 6 mm a pixel
WIDE_SIGHT_ANGLE = math.radians(60.0)  # rad between the two lines of sight
WIDE_ELEVATION = math.radians(25.0)  # rad, elevation of both


def high_speed_pair() -> tuple[Camera, Camera]:
    """Return the fast cameras (left, right). Both stand on the side y < 0.7625 and see 13 cm of the flight; left is nearer to the net."""
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
    """Return the wide cameras (wide_left, wide_right).

    Both stand on the side y < 0 and see the ball from the strike to behind the opponent's end; left is nearer to the robot. Where those of
    the dissertation stood is not printed.
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
