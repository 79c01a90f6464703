"""Error of the measured ball if no images are rendered, as fitted to rendered balls by `sensor_error_fit`.

Each of the nine errors is normally distributed. Its variance is the sum of four parts: a constant one, one for spin (|w| / 300 rad/s)^2,
one for speed s^2 and one for blur s^4, with s = |v| / 5 m/s. The errors are correlated as fitted. The time of the measurement needs no fit:
it is that of the last image that is used, which follows from geometry and light. The fit covers the launcher's balls of all scales, up to
14 m/s, and as many balls slower than 3 m/s, down to rest. These are all that scenarios play. A ball faster than FASTEST_BALL is refused,
because the fit does not cover it.

A burst is the set of images of one ball's passage through the high-speed cameras, six pairs by default.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import yaml
from numba import njit
from scipy.optimize import nnls
from tt_core.constants import BALL_RADIUS
from tt_core.physics import Physics
from tt_core.states import Array, BallState
from tt_sim.render import SHARPNESS, Lamps, Texture
from tt_sim.world.outcome import free_flight_positions
from tt_vision.camera import Camera
from tt_vision.capture.assembler import BurstParams
from tt_vision.detection.ball_detection import SATURATED
from tt_vision.detection.outline import BALL_THRESHOLD
from tt_vision.projection import project_from_table, unpack_camera
from tt_vision.rig import FRAME_RATE

FASTEST_BALL = 16.0  # m/s, the catapult's fastest ball with its scatter
FIT_SPIN, FIT_SPEED = 300.0, 5.0  # rad/s, m/s: units of the fit
IMAGE_MARGIN = 2.0  # pixels that an image must show around a whole ball
SEARCHED_FRAMES = 60  # number of frames after the launch in which the burst is searched for
BALL_ALBEDO = 0.85  # albedo of the default ball without marks, see tt_sim.render.Texture
UNMARKED = 0.88  # of the full-scale pixels that marks with their blurred edges leave: mean of 52 rendered images
FULL = 254.5 / 255.0  # grey that an image of 8 bits rounds to full scale
_RINGS = np.arange(64)
DISC = np.column_stack(
    [np.sqrt((_RINGS + 0.5) / 64) * f(math.pi * (3.0 - math.sqrt(5.0)) * _RINGS) for f in (np.cos, np.sin)]
)  # even over it
ERROR_NAMES = tuple(f"{what}_{axis}" for what in ("position", "velocity", "spin") for axis in "xyz")


@dataclass(frozen=True, eq=False)
class SensorErrorModel:
    """Random errors of the measured ball.

    Attributes:
        refused: Share of the balls with a burst of images that are not measured.
        parts: (9, 4) variances of position (m^2), velocity (m^2/s^2) and spin (rad^2/s^2) for each of the four parts.
        correlation: (9, 9) correlation of the errors.
    """

    refused: float
    parts: Array
    correlation: Array

    @classmethod
    def fitted(cls, errors: Array, speeds: Array, spins: Array, refused: float) -> SensorErrorModel:
        """Fit a model to errors of rendered balls.

        Args:
            errors: (n, 9) measured minus true position (m), velocity (m/s) and spin (rad/s).
            speeds: (n,) m/s, true speeds.
            spins: (n,) rad/s, true spins.
            refused: Share of the balls that are not measured.
        """
        causes = _causes(speeds, spins).T
        # each square is weighted by the inverse of its own expectation, which is refined in three passes
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
        """Read a model from the file `name` in `sensor_error_models/`."""
        return _load(name)

    def save(self, file: Path, comment: str) -> None:
        """Write the model to a YAML file.

        Args:
            file: The file.
            comment: Text of its first line.
        """
        rows = {name: [float(f"{v:.4g}") for v in row] for name, row in zip(ERROR_NAMES, self.parts, strict=True)}
        content = {"refused": round(self.refused, 4), "variances": rows, "correlation": np.round(self.correlation, 3).tolist()}
        file.write_text(f"# {comment}\n{yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=140)}")

    def sigmas(self, ball: BallState) -> Array:
        """Return the standard deviations (9,) of position (m), velocity (m/s) and spin (rad/s) for a true ball."""
        causes = _causes(math.hypot(*ball.velocity.tolist()), math.hypot(*ball.spin.tolist()))
        return np.asarray(np.sqrt(self.parts @ causes))

    def measured(self, ball: BallState, rng: np.random.Generator) -> BallState:
        """Return a ball with random errors, as it would be measured, and their covariance.

        Args:
            ball: The true ball.
            rng: Random numbers.
        """
        sigmas = self.sigmas(ball)
        covariance = self.correlation * np.outer(sigmas, sigmas)
        return BallState.from_vector(ball.time, ball.vector + sigmas * (self._root @ rng.standard_normal(9)), covariance)

    @functools.cached_property
    def _root(self) -> Array:
        values, vectors = np.linalg.eigh(self.correlation)
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _causes(speeds: Array | float, spins: Array | float) -> Array:
    """Return (4, n) for balls at speeds (n,) m/s and spins (n,) rad/s, or (4,) for one."""
    s = speeds / FIT_SPEED
    return np.array([s**0, (spins / FIT_SPIN) ** 2, s**2, s**4])


@functools.cache
def _load(name: str) -> SensorErrorModel:
    content = yaml.safe_load((Path(__file__).parent / "sensor_error_models" / f"{name}.yaml").read_text())
    parts = np.array([content["variances"][key] for key in ERROR_NAMES])
    return SensorErrorModel(content["refused"], parts, np.array(content["correlation"]))


@njit(cache=True, error_model="numpy")
def _whole(camera: Array, width: int, height: int, points: Array) -> npt.NDArray[np.bool_]:
    """Return (n,) whether an image of `width` by `height` shows all of a ball at points (n, 3) m; camera: Camera.vector."""
    model, whole = unpack_camera(camera), np.empty(len(points), dtype=np.bool_)
    radius = model.optics.focal * BALL_RADIUS
    for i in range(len(points)):
        u, v, depth = project_from_table(model, points[i, 0], points[i, 1], points[i, 2])
        room = radius / depth + IMAGE_MARGIN
        whole[i] = room < u < width - 1 - room and room < v < height - 1 - room
    return whole


class BallLight(NamedTuple):
    """Light on a white ball, for compiled functions.

    Attributes:
        places: (lamps, 3) m in `table`, positions of the lamps.
        strengths: (lamps,) grey level of an ideal white surface that faces the lamp from 1 m; 1 is full scale.
        ambient: Grey level of an ideal white surface without the lamps.
        background: Grey level behind the ball.
        albedo: Albedo of the ball without marks.
        gloss: Specular reflectance of the ball.
    """

    places: Array
    strengths: Array
    ambient: float
    background: float
    albedo: float
    gloss: float


def illumination(lamps: Lamps, texture: Texture) -> BallLight:
    """Return the light of the given lamps on the white part of a ball.

    Args:
        lamps: The lamps.
        texture: Surface of the ball; its gloss is used.
    """
    places = np.array([lamp.position for lamp in lamps.lamps]).reshape(-1, 3)
    strengths = np.array([lamp.strength for lamp in lamps.lamps])
    return BallLight(places, strengths, lamps.ambient, lamps.background, BALL_ALBEDO, texture.gloss)


@njit(cache=True, error_model="numpy")
def brightest(point: Array, light: BallLight) -> float:
    """Return an upper bound of the grey level (1 is full scale) of a ball, whatever side it is seen from.

    Args:
        point: (3,) m in `table`, position of the ball.
        light: Light on the ball.
    """
    n = len(light.strengths)
    each, ways = np.empty(n), np.empty((n, 3))  # grey of a white surface that faces one lamp; unit vectors
    for k in range(n):
        for axis in range(3):
            ways[k, axis] = light.places[k, axis] - point[axis]
        far = math.sqrt(ways[k, 0] ** 2 + ways[k, 1] ** 2 + ways[k, 2] ** 2)
        each[k] = light.strengths[k] / max(far - BALL_RADIUS, 1e-3) ** 2
        for axis in range(3):
            ways[k, axis] /= far
    # the lamps S that a normal faces give it |sum of s u over S| at most, the square of which is the sum over pairs of s s cos
    square = 0.0
    for i in range(n):
        for k in range(n):
            square += each[i] * each[k] * max(0.0, ways[i, 0] * ways[k, 0] + ways[i, 1] * ways[k, 1] + ways[i, 2] * ways[k, 2])
    return light.albedo * (light.ambient + math.sqrt(square)) + light.gloss * each.sum()


@njit(cache=True, error_model="numpy")
def saturated_share(point: Array, eye: Array, light: BallLight) -> float:
    """Return the share of the bright part of a ball's image that is at full scale. `find_ball` refuses an image above SATURATED.

    The light is computed as by the renderer, diffuse with a specular lobe, at points that are evenly distributed over the visible disc.

    Args:
        point: (3,) m in `table`, position of the ball.
        eye: (3,) m in `table`, position of the camera.
        light: Light on the ball.
    """
    zx, zy, zz = eye[0] - point[0], eye[1] - point[1], eye[2] - point[2]  # the axes of the disc: z to the camera, x level
    length = math.sqrt(zx * zx + zy * zy + zz * zz)
    zx, zy, zz = zx / length, zy / length, zz / length
    level = math.sqrt(zx * zx + zy * zy)  # no camera looks straight down
    xx, xy = -zy / level, zx / level
    yx, yy, yz = -zz * xy, zz * xx, zx * xy - zy * xx
    greys = np.empty(len(DISC))
    for i in range(len(DISC)):
        a, b = DISC[i, 0], DISC[i, 1]
        c = math.sqrt(1.0 - a * a - b * b)
        nx, ny, nz = a * xx + b * yx + c * zx, a * xy + b * yy + c * zy, b * yz + c * zz
        grey = light.albedo * light.ambient
        for k in range(len(light.strengths)):
            lx = light.places[k, 0] - point[0] - BALL_RADIUS * nx
            ly = light.places[k, 1] - point[1] - BALL_RADIUS * ny
            lz = light.places[k, 2] - point[2] - BALL_RADIUS * nz
            square = lx * lx + ly * ly + lz * lz
            far = math.sqrt(square)
            facing = (nx * lx + ny * ly + nz * lz) / far
            if facing > 0.0:
                towards = (zx * lx + zy * ly + zz * lz) / far
                lobe = (facing + c) ** 2 / (2.0 + 2.0 * towards)  # square of the cosine between the normal and half way from lamp to eye
                for _ in range(SHARPNESS - 1):
                    lobe *= lobe
                grey += light.strengths[k] / square * (light.albedo * facing + light.gloss * lobe)
        greys[i] = grey
    threshold = light.background + BALL_THRESHOLD * (min(1.0, greys.max()) - light.background)
    bright, full = 0, 0
    for i in range(len(greys)):
        bright += greys[i] > threshold
        full += greys[i] >= FULL
    return UNMARKED * full / bright


@njit(cache=True)
def _last_of_burst(whole: npt.NDArray[np.bool_], points: Array, eyes: Array, light: BallLight, frames: int) -> int:
    """Return the index of the frame that completes a burst, -1 if none does."""
    found = 0
    for i in range(len(points)):
        if not whole[i]:
            continue
        shown, is_dim = True, brightest(points[i], light) < FULL
        for eye in eyes:
            shown = is_dim or (shown and saturated_share(points[i], eye, light) <= SATURATED)
        found += shown
        if found == frames:
            return i
    return -1


@functools.lru_cache(maxsize=1)
def _light(lamps: Lamps) -> BallLight:
    return illumination(lamps, Texture.plain())


def last_frame(
    ball: BallState,
    cameras: tuple[Camera, ...],
    physics: Physics,
    frames: int = BurstParams.frames,
    lamps: Lamps | None = None,
) -> float | None:
    """Return the time (s) of the last frame of the burst, the set of images from which a ball is measured.

    The burst consists of the first frames that both cameras can use: the whole ball is in view, and the lamps do not overexpose it.

    Args:
        ball: The ball at its launch.
        cameras: The high-speed cameras.
        physics: True physics of the ball.
        frames: Number of frames of a burst.
        lamps: The light; None for that of the default scene.

    Returns:
        The time; None if there are not enough such frames.
    """
    times = np.arange(1, SEARCHED_FRAMES) / FRAME_RATE
    points = free_flight_positions(ball.vector, times, physics.air.coefficients)
    whole = np.logical_and.reduce([_whole(camera.vector, camera.width, camera.height, points) for camera in cameras])
    last = _last_of_burst(whole, points, np.array([camera.position for camera in cameras]), _light(lamps or Lamps()), frames)
    return None if last < 0 else ball.time + float(times[last])
