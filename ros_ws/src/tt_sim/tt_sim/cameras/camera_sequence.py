"""Images that the high-speed cameras take of one launched ball while it is in view."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation
from tt_core.arrays import Array, Image
from tt_core.constants import BALL_RADIUS
from tt_core.flight import fly
from tt_core.physics import Physics
from tt_core.states import BallState
from tt_vision.camera import Camera
from tt_vision.rig import EXPOSURE, FRAME_RATE

from ..render import Scene, render

IN_VIEW = 0.2  # s after the launch in which a frame may show the ball


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """The images of all cameras at one instant.

    Attributes:
        time: s, the middle of the exposure.
        images: One (h, w) for each camera.
    """

    time: float
    images: tuple[Image, ...]


def in_view(camera: Camera, ball: BallState) -> bool:
    """Tell whether any part of the ball can be in the image of a camera."""
    depth = float((camera.rotation @ ball.position + camera.translation)[2])
    if depth < 2.0 * BALL_RADIUS:
        return False
    u, v = camera.project(ball.position[None])[0]
    reach = camera.focal_length / camera.pixel_size * BALL_RADIUS / depth
    return -reach <= u <= camera.width - 1 + reach and -reach <= v <= camera.height - 1 + reach


def orientation_after(orientation: Array, ball: BallState, duration: float, physics: Physics) -> Array:
    """Return the orientation of a ball after some free flight.

    Args:
        orientation: (3, 3) from the ball's frame to `table` at the beginning.
        ball: The ball at the beginning.
        duration: s.
        physics: True physics, for the decay of the spin.

    Returns:
        (3, 3) from the ball's frame to `table` at the end.
    """
    decay = physics.air.spin_decay
    turned = -math.expm1(-decay * duration) / decay if decay > 0.0 else duration
    return Rotation.from_rotvec(ball.spin * turned).as_matrix() @ orientation


def camera_sequence(
    ball: BallState,
    orientation: Array,
    cameras: Sequence[Camera],
    scene: Scene,
    physics: Physics,
    rng: np.random.Generator,
    frame_rate: float = FRAME_RATE,
    exposure: float = EXPOSURE,
) -> Iterator[Frame]:
    """Render the images of one ball, from the first frame in which any camera has it in view until no camera has.

    Args:
        ball: The ball at its launch.
        orientation: (3, 3) from the ball's frame to `table` at the launch.
        cameras: The cameras.
        scene: Marks, light and sensor.
        physics: True physics of the ball.
        rng: Random numbers for the noise.
        frame_rate: 1/s. Frames are at whole periods after the launch.
        exposure: s.

    Yields:
        The images of all cameras, frame by frame.
    """
    seen = False
    for i in range(1, math.ceil(IN_VIEW * frame_rate)):
        after = i / frame_rate
        now = BallState.from_vector(ball.time + after, fly(ball.vector, after, physics.air.coefficients))
        if not any(in_view(camera, now) for camera in cameras):
            if seen:
                return
            continue
        seen = True
        turned = orientation_after(orientation, ball, after, physics)
        images = tuple(render(camera, now, turned, scene.texture, scene.lamps, exposure, scene.noise, rng) for camera in cameras)
        yield Frame(now.time, images)
