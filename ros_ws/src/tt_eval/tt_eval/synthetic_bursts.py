"""Random bursts of rendered images with the true states of the ball, under conditions that can be made worse one by one.

A burst is the set of images of one ball's passage through the high-speed cameras, six pairs by default.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from tt_core.constants import RPM
from tt_core.physics import Physics
from tt_core.states import Array, BallState
from tt_sim.domain_randomization import DomainRandomization
from tt_sim.render import Lamps, Noise, Texture, render
from tt_vision.camera import Camera
from tt_vision.capture.burst import Burst
from tt_vision.detection.illumination import CalibratedLamps
from tt_vision.rig import EXPOSURE, FRAME_RATE, VIEW_CENTRE, high_speed_pair

VARIED = DomainRandomization(drag=0.04, lift=0.10)  # from ball to ball, as in the world `real`


@dataclass(frozen=True)
class BurstConditions:
    """Conditions under which bursts are rendered.

    Attributes:
        frames: Number of pairs of images; 6 is the dissertation's K.
        frame_rate: 1/s.
        exposure: s.
        slowest: rpm, least spin, about any axis.
        fastest: rpm, largest spin.
        blobs: Number of marks on the ball.
        coverage: Share of the ball's surface that they cover.
        gloss: Specular reflectance of the ball.
        pose_angle: rad, standard deviation of the rotation of each camera between its true pose and the pose that the estimator assumes.
        pose_shift: m, standard deviation of each coordinate of the shift between these poses.
        lamps: The light.
        noise: Lens and sensor.
    """

    frames: int = 6
    frame_rate: float = FRAME_RATE
    exposure: float = EXPOSURE
    slowest: float = 0.0
    fastest: float = 9000.0
    blobs: int = 12
    coverage: float = 0.13
    gloss: float = 0.04
    pose_angle: float = 0.0
    pose_shift: float = 0.0
    lamps: Lamps = field(default_factory=Lamps)
    noise: Noise = field(default_factory=Noise)


@dataclass(frozen=True, eq=False)
class SyntheticBurst:
    """A rendered burst of images and the true state of the ball.

    Attributes:
        images: (2, k, h, w) uint8 or uint16, left and right.
        times: (k,) s.
        ball: True state of the ball at the last frame.
        cameras: Cameras in the poses that the estimator assumes.
    """

    images: Any
    times: Array
    ball: BallState
    cameras: tuple[Camera, ...]

    @property
    def burst(self) -> Burst:
        """The burst in the form that the estimator gets."""
        return Burst(tuple(self.images), self.times, self.cameras)

    @property
    def left_burst(self) -> Burst:
        """The burst of the left camera alone, in the form that the estimator gets."""
        return Burst((self.images[0],), self.times, self.cameras[:1])


def bursts(count: int, conditions: BurstConditions | None = None, seed: int = 0) -> Iterator[SyntheticBurst]:
    """Render random balls of 3 to 8 m/s near the middle of the view, with spin about any axis, in the air of real balls.

    Args:
        count: Number of balls.
        conditions: Conditions of all of them; None for the default ones.
        seed: Seed of all random numbers.

    Yields:
        Bursts with the true states.
    """
    c = conditions or BurstConditions()
    rng = np.random.default_rng(seed)
    for _ in range(count):
        direction = np.array([-1.0, rng.uniform(-0.08, 0.08), rng.uniform(-0.1, 0.35)])
        velocity = rng.uniform(3.0, 8.0) * direction / np.linalg.norm(direction)
        axis = rng.standard_normal(3)
        spin = rng.uniform(c.slowest, c.fastest) * RPM * axis / np.linalg.norm(axis)
        middle = np.array(VIEW_CENTRE) + rng.uniform(-0.012, 0.012, 3)
        texture = replace(_drawn(int(rng.integers(20)), c.blobs, c.coverage), gloss=c.gloss)
        yield render_burst(middle, velocity, spin, texture, c, rng)


@functools.cache
def _drawn(seed: int, blobs: int, coverage: float) -> Texture:
    return Texture.drawn(seed, blobs=blobs, coverage=coverage)


def render_burst(
    middle: Array, velocity: Array, spin: Array, texture: Texture, conditions: BurstConditions, rng: np.random.Generator
) -> SyntheticBurst:
    """Render the burst of one ball.

    Args:
        middle: (3,) m in `table`, position of the ball in the middle of the burst.
        velocity: (3,) m/s in `table`, then.
        spin: (3,) rad/s in `table`.
        texture: Surface of the ball with its marks.
        conditions: Conditions of the burst.
        rng: Random numbers for orientation, air and noise.
    """
    c = conditions
    first = Rotation.random(random_state=int(rng.integers(1 << 31)))
    times = rng.uniform(0.0, 100.0) + np.arange(c.frames) / c.frame_rate
    pull = VARIED.draw(Physics.measured(), rng).air.acceleration(velocity, spin) if velocity.any() else np.zeros(3)
    cameras = high_speed_pair()
    images = []
    for tau in times - times.mean():
        ball = BallState(times.mean() + tau, middle + tau * velocity + 0.5 * tau**2 * pull, velocity + tau * pull, spin)
        turned = (Rotation.from_rotvec(tau * spin) * first).as_matrix()
        images.append([render(camera, ball, turned, texture, c.lamps, c.exposure, c.noise, rng) for camera in cameras])
    believed = tuple(_moved(camera, c, rng) for camera in cameras)
    return SyntheticBurst(np.swapaxes(np.array(images), 0, 1), times, ball, believed)


def _moved(camera: Camera, c: BurstConditions, rng: np.random.Generator) -> Camera:
    if not (c.pose_angle or c.pose_shift):
        return camera
    turn = Rotation.from_rotvec(rng.normal(0.0, c.pose_angle, 3)).as_matrix()
    return replace(camera, rotation=turn @ camera.rotation, translation=camera.translation + rng.normal(0.0, c.pose_shift, 3))


def calibrated_lamps(lamps: Lamps) -> CalibratedLamps:
    """Return the lamps as a calibration would give them: positions, strengths and ambient light, without flicker and gloss."""
    each = lamps.lamps
    return CalibratedLamps(np.array([lamp.position for lamp in each]), np.array([lamp.strength for lamp in each]), lamps.ambient)
