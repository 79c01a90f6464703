"""Faults between the high-speed cameras and the estimator: images are late, have wrong stamps, are lost or arrive twice."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from tt_core.arrays import Image
from tt_core.params import check, param

from .camera_sequence import Frame


@dataclass(frozen=True, slots=True)
class CameraFaults:
    """Faults of the high-speed cameras. All are zero for a perfect pair."""

    latency: float = param(0.0, "s", "time from the middle of the exposure to the arrival of the image", low=0.0, high=1.0)
    jitter: float = param(0.0, "s", "standard deviation of the stamp of an image", low=0.0, high=0.01)
    clock_offset: float = param(0.0, "s", "offset of the clock of the cameras, ahead of the clock of the arm", low=-1.0, high=1.0)
    apart: float = param(0.0, "s", "offset of the stamps of the right camera, ahead of those of the left one", low=-0.01, high=0.01)
    dropped: float = param(0.0, "", "share of images that never arrive", low=0.0, high=1.0)
    duplicated: float = param(0.0, "", "share of images that arrive twice", low=0.0, high=1.0)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


def arrivals(frames: Iterable[Frame], faults: CameraFaults, rng: np.random.Generator) -> Iterator[tuple[int, float, Image]]:
    """Apply the faults to the frames of a ball.

    Args:
        frames: The frames as the cameras take them.
        faults: The faults. The latency is not applied here, because it does not change stamps.
        rng: Random numbers for losses, repetitions and jitter.

    Yields:
        Camera (0 left, 1 right), stamp (s) and image, as the estimator gets them.
    """
    for frame in frames:
        for side, image in enumerate(frame.images):
            lost, twice, shift = rng.uniform(), rng.uniform(), rng.normal()
            if lost < faults.dropped:
                continue
            stamp = frame.time + faults.clock_offset + side * faults.apart + faults.jitter * shift
            yield side, stamp, image
            if twice < faults.duplicated:
                yield side, stamp, image
