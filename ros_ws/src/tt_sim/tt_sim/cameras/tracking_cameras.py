"""What two wide cameras at 150 Hz make of a ball: they follow it on board and tell the pixel of its centre (dissertation Section 4.5.2)."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

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

LONGEST = 3.0  # s after the launch, that a ball is followed


@dataclass(frozen=True, slots=True)
class TrackingCameraFaults:
    """How wide cameras differ from perfect ones.

    noise is the scatter of the centroid of a ball 7 pixels wide, its image rendered with its marks in the light of three lamps overhead and
    cut at 0.3 of its brightness (tests/sim/test_wide.py: 0.09 pixels); 2 ms of motion blur do not shift it.
    """

    noise: float = param(0.1, "pixels", "standard deviation of each pixel coordinate of the ball", low=0.0, high=10.0)
    step: float = param(0.0625, "pixels", "resolution of the pixel coordinates of the ball, an assumption; 0: none", low=0.0, high=10.0)
    turned: float = param(
        0.0, "rad", "standard deviation of the rotation of each camera about each of its axes since it was calibrated", low=0.0, high=0.1
    )
    dropped: float = param(0.0, "", "share of pixel coordinates that never arrive", low=0.0, high=1.0)
    latency: float = param(0.0, "s", "time from the middle of the exposure to the message of the simulator node", low=0.0, high=1.0)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


@functools.cache
def believed() -> tuple[Camera, Camera]:
    """The pair as it was calibrated."""
    return wide_pair()


@njit(cache=True)
def _tell(camera: Array, width: int, height: int, places: Array, lost: npt.NDArray[np.bool_], step: float, pixels: Array) -> None:
    """Turns the scatter of centres, pixels (n, 2), into centres, in place, of a ball at places (n, 3) m that are not lost (n,)."""
    model = unpack_camera(camera)
    for i in range(len(places)):
        u, v, _ = project_from_table(model, places[i, 0], places[i, 1], places[i, 2])
        u, v = u + pixels[i, 0], v + pixels[i, 1]
        if step > 0.0:
            u, v = np.rint(u / step) * step, np.rint(v / step) * step
        told = not lost[i] and 0.0 <= u <= width - 1 and 0.0 <= v <= height - 1
        pixels[i, 0], pixels[i, 1] = (u, v) if told else (np.nan, np.nan)


class TrackingCameraPair:
    """The pair as it really stands. rng: of where that is."""

    def __init__(self, faults: TrackingCameraFaults, rng: np.random.Generator) -> None:
        self.faults = faults
        self.cameras = tuple(_turned(camera, faults.turned, rng) for camera in believed())

    def pixels(self, places: Array, rng: np.random.Generator) -> Array:
        """(2, n, 2) of a ball at `places` (n, 3) m, NaN where a camera does not see it or does not tell."""
        faults, n = self.faults, len(places)
        seen = faults.noise * rng.standard_normal((2, n, 2))
        dropped = rng.uniform(size=(2, n)) < faults.dropped
        for camera, scatter, lost in zip(self.cameras, seen, dropped, strict=True):
            _tell(camera.vector, camera.width, camera.height, places, lost, faults.step, scatter)
        return seen


class TrackingCameras:
    """The pair in a running world, frame by frame from `start` (s) on. air: coefficients of the balls, good enough for a part of a tick."""

    def __init__(self, faults: TrackingCameraFaults, air: Array, start: float, rng: np.random.Generator) -> None:
        self._pair, self._air, self._rng, self._due = TrackingCameraPair(faults, rng), air, rng, start

    def frames(self, tick: Tick, wanted: bool = True) -> list[tuple[float, int, Array]]:
        """(stamp s, 0 left or 1 right, pixel (2,)) of the frames during the tick that show the ball; none of them when not wanted."""
        seen = []
        while self._due <= tick.joints.time:
            then = next((contact.before for contact in tick.contacts if contact.before.time >= self._due), tick.ball)
            if wanted and then is not None:
                place = fly(then.vector, self._due - then.time, self._air)[None, :3]
                pixels = self._pair.pixels(place, self._rng)[:, 0]
                seen += [(self._due, side, pixel) for side, pixel in enumerate(pixels) if np.isfinite(pixel).all()]
            self._due += 1.0 / WIDE_RATE
        return seen


def _turned(camera: Camera, sigma: float, rng: np.random.Generator) -> Camera:
    if sigma == 0.0:
        return camera
    turn = Rotation.from_rotvec(rng.normal(0.0, sigma, 3)).as_matrix()
    return replace(camera, rotation=turn @ camera.rotation, translation=turn @ camera.translation)


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """Where both cameras saw the ball. times: (n,) s, rising. pixels: (2, n, 2)."""

    times: Array
    pixels: Array

    @classmethod
    def of(cls, outcome: Outcome, air: Array, faults: TrackingCameraFaults, rng: np.random.Generator) -> Sightings:
        """Of a whole flight, from launch to end, by cameras that do not wait for it. air: coefficients of the true one."""
        first, pair = outcome.launched.time + rng.uniform() / WIDE_RATE, TrackingCameraPair(faults, rng)
        times = np.arange(first, outcome.followed_until(outcome.launched.time + LONGEST), 1.0 / WIDE_RATE)
        pixels = pair.pixels(outcome.places(times, air), rng)
        both = np.isfinite(pixels).all(axis=(0, 2))
        return cls(times[both], pixels[:, both])
