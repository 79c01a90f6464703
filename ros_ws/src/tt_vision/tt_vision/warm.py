"""Warm-up: compile the functions (kernels) of the measurement and make its tables before the first ball, so that no ball waits for them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from tt_core.constants import BALL_RADIUS
from tt_core.physics import Physics
from tt_core.states import Array, BallState

from .camera import Camera
from .detection.illumination import CalibratedLamps
from .first_estimate import SEARCHED
from .measure import measure
from .spin.coarse_search import prepare_search
from .tracking import Tracker


def warm(cameras: Sequence[Camera]) -> None:
    """Compile every function and make every table that the measurement of a ball uses, by measuring synthetic images of 8 and of 16 bits.

    Args:
        cameras: Two cameras with images of the same size, whose lines of sight meet about 1 m in front of them.
    """
    axis = np.mean([camera.rotation[2] for camera in cameras], axis=0)
    start = np.mean([camera.position for camera in cameras], axis=0) + axis
    times = np.arange(SEARCHED + 1) / 900.0
    frames = [[_draw(camera, start + t * np.array([0.0, 0.0, 2.0]), 100.0 * t) for t in times] for camera in cameras]
    for dtype in (np.uint8, np.uint16):
        left, right = (np.array(images, dtype=dtype) for images in frames)
        measure(left, right, times, cameras)  # refused: what is drawn is no ball that both cameras see
        measure(left, None, times, cameras[:1])
    measure(left, None, times, cameras[:1], lamps=CalibratedLamps(start[None] + 1.0, np.ones(1), 1.0))
    prepare_search()


def warm_tracker(cameras: Sequence[Camera]) -> None:
    """Compile every function of the tracker, by tracking a simulated ball that flies and bounces.

    Args:
        cameras: Wide cameras that see the table.
    """
    state = np.array([1.6, 0.76, 0.2, -6.0, 0.0, -1.0, 0.0, -100.0, 0.0])
    physics = Physics.measured()
    found, started = Tracker(physics, cameras), Tracker(physics, cameras)
    started.start(BallState.from_vector(0.0, state, np.diag(np.repeat([1e-3, 0.05, 10.0], 3) ** 2)))
    for time in np.arange(1, 90) / 150.0:
        ball = started.state(time)
        if ball is not None:
            for tracker in (found, started):
                for index, camera in enumerate(cameras):
                    tracker.add_pixel(time, index, camera.project(ball.position[None])[0], 0.1)
                tracker.add_position(time, ball.position, np.eye(3) * 1e-6)
                tracker.state()


def _draw(camera: Camera, centre: Array, angle: float) -> np.ndarray:
    """Return a synthetic image (h, w) of a chequered ball.

    Args:
        camera: The camera that takes the image.
        centre: (3,) m in `table`, centre of the ball.
        angle: rad, by which the ball has turned about the vertical axis of the image.
    """
    v, u = np.mgrid[: camera.height, : camera.width]
    depth = (camera.rotation @ centre + camera.translation)[2]
    middle_u, middle_v = camera.project(centre[None])[0]
    x, y = u - middle_u, v - middle_v
    radius = camera.focal_pixels * BALL_RADIUS / depth
    z = np.sqrt(np.maximum(0.0, radius**2 - x * x - y * y))
    dark = np.sin(5.0 * (np.arctan2(x, z) - angle)) * np.sin(6.0 * y / radius) > 0.4
    return np.where(z > 0.0, np.where(dark, 40, 200), 8)
