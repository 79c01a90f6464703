"""What goes wrong between shutter and estimator: late, at wrong stamps, lost, twice."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from tt_core.errors import check_range

from ..render import Image
from .camera_sequence import Frame


@dataclass(frozen=True, slots=True)
class CameraFaults:
    """All zero is the perfect camera. latency and clock_offset do not change what is measured, only when."""

    latency: float = 0.0  # s, mean, from the exposure to the estimator
    jitter: float = 0.0  # s, standard deviation of a stamp
    clock_offset: float = 0.0  # s, by which the cameras' clock is ahead of the arm's
    apart: float = 0.0  # s, by which the right camera's stamps are ahead of the left one's
    dropped: float = 0.0  # share of images that never come
    duplicated: float = 0.0  # share of images that come twice

    def __post_init__(self) -> None:
        check_range("latency", self.latency, 0.0, 1.0)
        check_range("jitter", self.jitter, 0.0, 0.01)
        check_range("clock_offset", self.clock_offset, -1.0, 1.0)
        check_range("apart", self.apart, -0.01, 0.01)
        check_range("dropped", self.dropped, 0.0, 1.0)
        check_range("duplicated", self.duplicated, 0.0, 1.0)


def arrivals(frames: Iterable[Frame], faults: CameraFaults, rng: np.random.Generator) -> Iterator[tuple[int, float, Image]]:
    """(side, stamp s, image) as the estimator gets them."""
    for frame in frames:
        for side, image in enumerate(frame.images):
            lost, twice, shift = rng.uniform(), rng.uniform(), rng.normal()
            if lost < faults.dropped:
                continue
            stamp = frame.time + faults.clock_offset + side * faults.apart + faults.jitter * shift
            yield side, stamp, image
            if twice < faults.duplicated:
                yield side, stamp, image
