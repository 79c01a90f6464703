"""What flows from the cameras to the measurement: images of one ball, where it is in each of them, and who took them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from tt_core.errors import BadShape, TtError, check_array
from tt_core.failures import Failure
from tt_core.states import Array

from ..camera import Camera

Image = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

LEAST_FRAMES = 3  # of a burst that is measured; with two, 8 % of the spins are wrong
MOST_FRAMES = 10  # of a burst that is measured; more add time and no accuracy


class TimesNotRising(TtError):
    """Times of frames that do not rise."""

    def __init__(self, times: Array) -> None:
        """Keep the times."""
        super().__init__(f"times must rise, got {times}")
        self.times = times


@dataclass(frozen=True)
class BallDetection:
    """Where the ball is in one image.

    Attributes:
        reason: Why the image does not show a whole ball, a code of `DetectionReason`; None if it does.
        u: Column of the ball's middle, pixels, within 2 pixels.
        v: Row of the ball's middle, pixels, within 2 pixels.
        radius: Pixels, roughly.
        background: Grey level of the background.
        peak: Grey level of the brightest part of the ball.
    """

    reason: Failure | None
    u: float = 0.0
    v: float = 0.0
    radius: float = 0.0
    background: float = 0.0
    peak: float = 0.0

    @property
    def contrast(self) -> float:
        """Grey levels between the background and the brightest part of the ball."""
        return self.peak - self.background


@dataclass(frozen=True, eq=False)
class Burst:
    """Images of one ball that one or two cameras took at the same instants.

    Attributes:
        images: One array (k, h, w), uint8 or uint16, of each camera.
        times: (k,) s, rising: the middle of the exposures.
        cameras: The camera of each array; empty as long as they are not known.
        detections: [camera][frame], where the ball is; empty, or with an empty row for a camera, where it has not been looked for.
        refined: Whether a shorter burst of the same ball came before.

    Raises:
        BadShape: Images, times and cameras do not fit together.
        NotFinite: A time is NaN or infinite.
        TimesNotRising: Times do not rise.
    """

    images: tuple[np.ndarray, ...]
    times: Array
    cameras: tuple[Camera, ...] = ()
    detections: tuple[tuple[BallDetection, ...], ...] = ()
    refined: bool = False

    def __post_init__(self) -> None:
        """Copy the times, and refuse what does not fit together."""
        times = check_array("times", self.times, (-1,))
        if (np.diff(times) <= 0.0).any():
            raise TimesNotRising(times)
        images = tuple(np.asarray(stack) for stack in self.images)
        counts, cameras = [len(stack) for stack in images], len(self.cameras) or len(images)
        if len(images) != cameras or any(count != len(times) for count in counts):
            raise BadShape("frames", (len(images), *counts), f"{cameras} cameras x {len(times)} frames")
        for camera, stack in zip(self.cameras, images, strict=False):
            if stack.shape[1:] != (camera.height, camera.width):
                raise BadShape("images", stack.shape, f"(k, {camera.height}, {camera.width})")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "images", images)
        object.__setattr__(self, "cameras", tuple(self.cameras))

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.times)

    @property
    def from_middle(self) -> Array:
        """(k,) s, the times from their mean on."""
        return np.asarray(self.times - np.mean(self.times))

    def seen_by(self, cameras: Sequence[Camera]) -> Burst:
        """Return the same images, taken by these cameras."""
        return replace(self, cameras=tuple(cameras))

    def only(self, frames: Sequence[int]) -> Burst:
        """Return a burst of some of the frames, by their numbers, rising."""
        if len(frames) == len(self):
            return self
        chosen = list(frames)
        detections = tuple(tuple(row[k] for k in chosen if row) for row in self.detections)
        return replace(self, images=tuple(stack[chosen] for stack in self.images), times=self.times[chosen], detections=detections)
