"""What the measurement gets wrong, without images: its errors as fitted to rendered balls, see `sensor_error_fit`.

Each of the nine errors is normal, with a variance that is the sum of four causes: none, spin (|w| / 300 rad/s)^2, speed s^2 and blur s^4
with s = |v| / 5 m/s; they are correlated as fitted. The time of the measurement needs no fit: it is that of the last frame of the burst,
which the geometry tells. Fitted to the catapult's balls of all scales, up to 14 m/s, and to as many slower than 3 m/s, down to rest: all
that scenarios play. A ball faster than FASTEST is refused, the fit says nothing about it.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import yaml
from numba import njit
from scipy.optimize import nnls
from tt_core.constants import BALL_RADIUS
from tt_core.physics import Physics
from tt_core.states import Array, BallState
from tt_sim.world.outcome import places
from tt_vision.camera import Camera
from tt_vision.capture.assembler import BurstParams
from tt_vision.projection import project_from_table, unpack_camera
from tt_vision.rig import FRAME_RATE

FASTEST = 16.0  # m/s, the catapult's fastest with its scatter
SPIN, SPEED = 300.0, 5.0  # rad/s, m/s: units of the fit
MARGIN = 2.0  # pixels that an image shows around a whole ball
FRAMES = 60  # after the launch, looked through for the burst
NAMES = tuple(f"{what}_{axis}" for what in ("position", "velocity", "spin") for axis in "xyz")


@dataclass(frozen=True, eq=False)
class SensorErrorModel:
    """refused: share of balls in view that are not measured. parts: (9, 4) variances by cause, SI. correlation: (9, 9)."""

    refused: float
    parts: Array
    correlation: Array

    @classmethod
    def fitted(cls, errors: Array, speeds: Array, spins: Array, refused: float) -> SensorErrorModel:
        """errors: (n, 9), measured minus true. speeds: (n,) m/s. spins: (n,) rad/s."""
        causes = _causes(speeds, spins).T
        # each square weighs as the inverse of its own expectation, in two passes
        parts = np.zeros((9, 4))
        for i in range(9):
            expected = np.full(len(errors), np.mean(errors[:, i] ** 2))
            for _ in range(3):
                parts[i] = nnls(causes / expected[:, None], errors[:, i] ** 2 / expected)[0]
                expected = np.maximum(causes @ parts[i], 1e-3 * np.mean(errors[:, i] ** 2))
        correlation = np.corrcoef((errors / np.sqrt(causes @ parts.T)).T)
        return cls(refused, parts, correlation)

    @classmethod
    def load(cls, name: str) -> SensorErrorModel:
        """A file of `sensor_error_models/`."""
        return _load(name)

    def save(self, file: Path, told: str) -> None:
        rows = {name: [float(f"{v:.4g}") for v in row] for name, row in zip(NAMES, self.parts, strict=True)}
        content = {"refused": round(self.refused, 4), "variances": rows, "correlation": np.round(self.correlation, 3).tolist()}
        file.write_text(f"# {told}\n{yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=140)}")

    def sigmas(self, ball: BallState) -> Array:
        """(9,) standard deviations for that ball."""
        causes = _causes(math.hypot(*ball.velocity.tolist()), math.hypot(*ball.spin.tolist()))
        return np.asarray(np.sqrt(self.parts @ causes))

    def measured(self, ball: BallState, rng: np.random.Generator) -> BallState:
        """`ball`, the truth, as it is seen."""
        sigmas = self.sigmas(ball)
        covariance = self.correlation * np.outer(sigmas, sigmas)
        return BallState.from_vector(ball.time, ball.vector + sigmas * (self._root @ rng.standard_normal(9)), covariance)

    @functools.cached_property
    def _root(self) -> Array:
        values, vectors = np.linalg.eigh(self.correlation)
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _causes(speeds: Array | float, spins: Array | float) -> Array:
    """(4, n) of balls at speeds (n,) m/s and spins (n,) rad/s, or (4,) of one."""
    s = speeds / SPEED
    return np.array([s**0, (spins / SPIN) ** 2, s**2, s**4])


@functools.cache
def _load(name: str) -> SensorErrorModel:
    content = yaml.safe_load((Path(__file__).parent / "sensor_error_models" / f"{name}.yaml").read_text())
    parts = np.array([content["variances"][key] for key in NAMES])
    return SensorErrorModel(content["refused"], parts, np.array(content["correlation"]))


@njit(cache=True, error_model="numpy")
def _whole(camera: Array, width: int, height: int, points: Array) -> npt.NDArray[np.bool_]:
    """(n,) whether an image of `width` by `height` shows all of a ball at points (n, 3) m. camera: Camera.vector."""
    model, whole = unpack_camera(camera), np.empty(len(points), dtype=np.bool_)
    radius = model.optics.focal * BALL_RADIUS
    for i in range(len(points)):
        u, v, depth = project_from_table(model, points[i, 0], points[i, 1], points[i, 2])
        room = radius / depth + MARGIN
        whole[i] = room < u < width - 1 - room and room < v < height - 1 - room
    return whole


def last_frame(ball: BallState, cameras: tuple[Camera, ...], physics: Physics, frames: int = BurstParams.frames) -> float | None:
    """s, of the last frame of the burst: the first `frames` that show the whole ball in all images; None when there are not enough."""
    times = np.arange(1, FRAMES) / FRAME_RATE
    points = places(ball.vector, times, physics.air.coefficients)
    whole = np.logical_and.reduce([_whole(camera.vector, camera.width, camera.height, points) for camera in cameras])
    seen = np.flatnonzero(whole)
    return None if len(seen) < frames else ball.time + float(times[seen[frames - 1]])
