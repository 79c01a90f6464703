"""The data that pass from the cameras to the measurement: a burst, and where the ball is in each of its images.

A burst holds the images of one ball's passage through the high speed cameras (about six pairs).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from tt_core.arrays import Array
from tt_core.errors import BadShape, TtError, check_array
from tt_core.failures import Failure

from ..camera import Camera

LEAST_FRAMES = 3  # frames that a burst must have to be measured; from two frames 8 % of the spins are wrong
MOST_FRAMES = 10  # frames of a burst that are used; more cost time and add no accuracy


class TimesNotRising(TtError):
    """Error: the times of frames are not in rising order."""

    def __init__(self, times: Array) -> None:
        """Keep the times."""
        super().__init__(f"times must rise, got {times}")
        self.times = times


@dataclass(frozen=True)
class BallDetection:
    """Result of looking for the ball in one image: where it is, or why the image does not show a whole ball.

    Attributes:
        reason: Why the image does not show a whole ball, with a code of `DetectionReason`; None if it shows one. Only then do the other
            attributes hold values.
        u: Column of the ball's centre, pixels, accurate to 2 pixels.
        v: Row of the ball's centre, pixels, accurate to 2 pixels.
        radius: Rough radius of the ball in the image, pixels.
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
        """Difference in grey levels between the brightest part of the ball and the background."""
        return self.peak - self.background


@dataclass(frozen=True, eq=False)
class Burst:
    """The images of one ball's passage through the high speed cameras: k frames (about six), each with one image per camera.

    One or two cameras take the images, all cameras at the same instants.

    Attributes:
        images: For each camera one array (k, h, w), uint8 or uint16.
        times: (k,) s, rising, the middle of the exposure of each frame.
        cameras: For each array of `images` the camera that took it; empty as long as the cameras are not known.
        detections: Where the ball is in each image, indexed [camera][frame]. It is empty, or has an empty row for a camera, as long as the
            ball has not been looked for there.
        refined: Whether this is the second, longer burst of a ball, which follows a shorter one.

    Raises:
        BadShape: The numbers of images, times and cameras, or the sizes of the images, do not fit together.
        NotFinite: A time is NaN or infinite.
        TimesNotRising: The times are not in rising order.
    """

    images: tuple[np.ndarray, ...]
    times: Array
    cameras: tuple[Camera, ...] = ()
    detections: tuple[tuple[BallDetection, ...], ...] = ()
    refined: bool = False

    def __post_init__(self) -> None:
        """Copy the times, and check that images, times and cameras fit together."""
        times = check_array("times", self.times, (-1,))
        if (np.diff(times) <= 0.0).any():
            raise TimesNotRising(times)
        images = tuple(np.ascontiguousarray(stack) for stack in self.images)  # Numba would compile again for strided ones
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
        """Times of the frames relative to their mean, (k,) s."""
        return np.asarray(self.times - np.mean(self.times))

    def seen_by(self, cameras: Sequence[Camera]) -> Burst:
        """Return a burst of the same images that is said to be taken by these cameras."""
        return replace(self, cameras=tuple(cameras))

    def only(self, frames: Sequence[int]) -> Burst:
        """Return a burst of some of the frames only.

        Args:
            frames: Indices of these frames, in rising order.
        """
        if len(frames) == len(self):
            return self
        chosen = list(frames)
        detections = tuple(tuple(row[k] for k in chosen if row) for row in self.detections)
        return replace(self, images=tuple(stack[chosen] for stack in self.images), times=self.times[chosen], detections=detections)
