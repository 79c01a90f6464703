"""Rendered bursts of one ball, with the truth."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tt_core.constants import RPM
from tt_core.flight import Aerodynamics
from tt_core.states import BallState
from tt_sim.render import Scene, render
from tt_vision.capture.burst import Burst
from tt_vision.detection.ball_detection import detect_balls
from tt_vision.rig import EXPOSURE, FRAME_RATE, VIEW_CENTRE, high_speed_pair


@dataclass(frozen=True)
class Footage:
    frames: np.ndarray  # (cameras, k, h, w)
    times: np.ndarray
    ball: BallState  # at the last frame
    cameras: tuple

    @property
    def burst(self):
        """With detections."""
        return detect_balls(Burst(tuple(self.frames), self.times, tuple(self.cameras)))

    @property
    def left_burst(self):
        return detect_balls(Burst((self.left,), self.times, tuple(self.cameras[:1])))

    @property
    def left(self):
        return self.frames[0]

    @property
    def right(self):
        return self.frames[1]


def shoot(seed, *, spin=None, count=6, scene=None, cameras=None, velocity=None, start=0.0, exposure=EXPOSURE, fastest=9000.0):
    """A ball through the view centre at 3 to 8 m/s; spin (3,) rpm, or any axis and up to `fastest` rpm."""
    rng = np.random.default_rng(seed)
    scene = scene or Scene()
    cameras = cameras or high_speed_pair()
    if velocity is None:
        direction = np.array([-1.0, rng.uniform(-0.08, 0.08), rng.uniform(-0.1, 0.35)])
        velocity = rng.uniform(3.0, 8.0) * direction / np.linalg.norm(direction)
    if spin is None:
        axis = rng.standard_normal(3)
        spin = rng.uniform(0.0, fastest) * axis / np.linalg.norm(axis)
    velocity, omega = np.asarray(velocity, dtype=float), RPM * np.asarray(spin, dtype=float)
    middle = np.array(VIEW_CENTRE) + rng.uniform(-0.01, 0.01, 3)
    first = Rotation.random(random_state=seed)
    times = start + np.arange(count) / FRAME_RATE
    images = [[] for _ in cameras]
    pull = Aerodynamics.measured().acceleration(velocity, omega)
    for t in times:
        tau = t - times.mean()
        ball = BallState(t, middle + tau * velocity + 0.5 * tau**2 * pull, velocity + tau * pull, omega)
        turned = (Rotation.from_rotvec(tau * omega) * first).as_matrix()
        for row, camera in zip(images, cameras, strict=True):
            row.append(render(camera, ball, turned, scene.texture, scene.lamps, exposure, scene.noise, rng))
    return Footage(np.array(images), times, ball, cameras)


@pytest.fixture(scope="session")
def rendered():
    return shoot(1)


@pytest.fixture(scope="session")
def film():
    """film(seed, ...): one more burst."""
    return shoot


@pytest.fixture(scope="session")
def scene():
    """scene(...): the default scene with other parts."""
    return lambda **parts: replace(Scene(), **parts)
