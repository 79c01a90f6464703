"""Two wide cameras at 150 Hz that find the ball on board and send the pixel of its centre (dissertation Section 4.5.2)."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.spatial.transform import Rotation
from tt_core.flight import fly
from tt_core.params import check, param
from tt_core.states import Array
from tt_vision.camera import Camera
from tt_vision.projection import project_from_table, unpack_camera
from tt_vision.rig import WIDE_RATE, wide_pair

from ..simulated_robot import Tick
from ..world.outcome import Outcome

FOLLOWED = 3.0  # s after the launch, that a ball is followed


@dataclass(frozen=True, slots=True)
class TrackingCameraFaults:
    """Differences of the wide cameras from perfect ones.

    The default noise is that of the centroid of a ball 7 pixels wide: tests/sim/test_tracking_cameras.py renders it with its marks in the
    light of three lamps, segments it at 0.3 of its brightness and finds 0.09 pixels. Motion blur of 2 ms does not shift the centroid.
    """

    noise: float = param(0.1, "pixels", "standard deviation of each pixel coordinate of the ball", low=0.0, high=10.0)
    step: float = param(0.0625, "pixels", "resolution of the pixel coordinates of the ball, an assumption; 0: none", low=0.0, high=10.0)
    turned: float = param(
        0.0, "rad", "standard deviation of the rotation of each camera about each of its axes since it was calibrated", low=0.0, high=0.1
    )
    dropped: float = param(0.0, "", "share of pixel coordinates that never arrive", low=0.0, high=1.0)
    latency: float = param(0.0, "s", "time from the middle of the exposure to the arrival of the pixel", low=0.0, high=1.0)
    late: float = param(0.0, "s", "largest further delay of a pixel on its way, all delays equally likely", low=0.0, high=1.0)
    outliers: float = param(0.0, "", "share of pixels that show something else, `outlier_distance` from the ball", low=0.0, high=1.0)
    outlier_distance: float = param(0.2, "m", "distance of that from the ball, in any direction", low=0.0, high=10.0)
    dead: int = param(0, "", "cameras that see nothing: 1 the right one, 2 both", low=0, high=2)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


@functools.cache
def believed() -> tuple[Camera, Camera]:
    """Return the pair of wide cameras as it was calibrated, i.e. as the robot assumes it to be."""
    return wide_pair()


@njit(cache=True)
def _fill_pixels(camera: Array, width: int, height: int, places: Array, lost: npt.NDArray[np.bool_], step: float, pixels: Array) -> None:
    """Project a ball, add noise and round, in place.

    Args:
        camera: Camera.vector.
        width: Pixels.
        height: Pixels.
        places: (n, 3) m, of the ball.
        lost: (n,) whether a pixel is not sent.
        step: Pixels, resolution; 0: none.
        pixels: (n, 2), the noise; becomes the pixel, NaN where the ball is lost or out of the image.
    """
    model = unpack_camera(camera)
    for i in range(len(places)):
        u, v, _ = project_from_table(model, places[i, 0], places[i, 1], places[i, 2])
        u, v = u + pixels[i, 0], v + pixels[i, 1]
        if step > 0.0:
            u, v = np.rint(u / step) * step, np.rint(v / step) * step
        is_seen = not lost[i] and 0.0 <= u <= width - 1 and 0.0 <= v <= height - 1
        pixels[i, 0], pixels[i, 1] = (u, v) if is_seen else (np.nan, np.nan)


class TrackingCameraPair:
    """The true pair of wide cameras, with its faults.

    Attributes:
        faults: Differences from a perfect pair.
        cameras: The cameras in their true poses.
    """

    def __init__(self, faults: TrackingCameraFaults, rng: np.random.Generator) -> None:
        """Rotate the calibrated cameras at random.

        Args:
            faults: Differences from a perfect pair, with the standard deviation of the rotations.
            rng: Random numbers for the rotations.
        """
        self.faults = faults
        self.cameras = tuple(_turned(camera, faults.turned, rng) for camera in believed())

    def pixels(self, places: Array, rng: np.random.Generator) -> Array:
        """Return the pixels at which the cameras see a ball, with noise and losses.

        Args:
            places: (n, 3) m in `table`, true centres of the ball.
            rng: Random numbers for noise, losses and outliers.

        Returns:
            (2, n, 2) column and row for each camera and place; NaN where the camera does not see the ball or its pixel is lost.
        """
        faults, n = self.faults, len(places)
        seen = faults.noise * rng.standard_normal((2, n, 2))
        dropped = rng.uniform(size=(2, n)) < faults.dropped
        dropped[2 - faults.dead :] = True
        for camera, scatter, lost in zip(self.cameras, seen, dropped, strict=True):
            shown = places
            if faults.outliers > 0.0:
                aside = rng.standard_normal((n, 3))
                aside *= faults.outlier_distance / np.linalg.norm(aside, axis=1, keepdims=True)
                shown = places + np.where(rng.uniform(size=(n, 1)) < faults.outliers, aside, 0.0)
            _fill_pixels(camera.vector, camera.width, camera.height, shown, lost, faults.step, scatter)
        return seen

    def delay(self, rng: np.random.Generator) -> float:
        """Return the time (s) from the middle of an exposure to the arrival of its pixel.

        Args:
            rng: Random numbers for the part of the delay that varies.
        """
        return self.faults.latency + (rng.uniform(0.0, self.faults.late) if self.faults.late > 0.0 else 0.0)


class TrackedPixel(NamedTuple):
    """Pixel of the ball in one frame of one wide camera."""

    arrival: float  # s, when the pixel arrives at the robot
    stamp: float  # s, middle of the exposure
    side: int  # 0 left, 1 right
    pixel: Array  # (2,) column and row of the ball's centre


class TrackingCameras:
    """The pair of wide cameras in a running simulation, frame by frame."""

    def __init__(self, pair: TrackingCameraPair, air: Array, start: float, rng: np.random.Generator) -> None:
        """Start with the first frame.

        Args:
            pair: The cameras.
            air: (8,) mean coefficients of the air (`Aerodynamics.coefficients`). They are accurate enough for a part of a tick.
            start: s, time of the first frame.
            rng: Random numbers for noise and losses.
        """
        self._pair, self._air, self._rng, self._due = pair, air, rng, start

    def frames(self, tick: Tick, wanted: bool = True) -> list[TrackedPixel]:
        """Return what the cameras see during a tick, one step of the simulated robot.

        Args:
            tick: The true state at the end of the tick.
            wanted: Whether any node needs the pixels. If not, frames are skipped and nothing is computed.

        Returns:
            The pixel of each frame of each camera that sees the ball.
        """
        seen = list[TrackedPixel]()
        while self._due <= tick.joints.time:
            then = next((contact.before for contact in tick.contacts if contact.before.time >= self._due), tick.ball)
            if wanted and then is not None:
                place = fly(then.vector, self._due - then.time, self._air)[None, :3]
                pixels = self._pair.pixels(place, self._rng)[:, 0]
                for side, pixel in enumerate(pixels):
                    if np.isfinite(pixel).all():
                        seen.append(TrackedPixel(self._due + self._pair.delay(self._rng), self._due, side, pixel))
            self._due += 1.0 / WIDE_RATE
        return seen


def _turned(camera: Camera, sigma: float, rng: np.random.Generator) -> Camera:
    if sigma == 0.0:
        return camera
    turn = Rotation.from_rotvec(rng.normal(0.0, sigma, 3)).as_matrix()
    return replace(camera, rotation=turn @ camera.rotation, translation=turn @ camera.translation)


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """Pixels at which both wide cameras saw one ball.

    Attributes:
        times: (n,) s, increasing.
        pixels: (2, n, 2) column and row of the left and of the right camera.
    """

    times: Array
    pixels: Array

    @classmethod
    def of(cls, outcome: Outcome, air: Array, faults: TrackingCameraFaults, rng: np.random.Generator) -> Sightings:
        """Return what a pair with random errors sees of a whole flight; frames that one of the cameras misses are left out.

        Args:
            outcome: The flight, from launch to end.
            air: (8,) coefficients of the true air (`Aerodynamics.coefficients`).
            faults: Faults of the pair.
            rng: Random numbers for the faults, and for the time of the first frame, because cameras are not synchronized with the launch.
        """
        first, pair = outcome.launched.time + rng.uniform() / WIDE_RATE, TrackingCameraPair(faults, rng)
        times = np.arange(first, outcome.followed_until(outcome.launched.time + FOLLOWED), 1.0 / WIDE_RATE)
        pixels = pair.pixels(outcome.places(times, air), rng)
        both = np.isfinite(pixels).all(axis=(0, 2))
        return cls(times[both], pixels[:, both])
