"""What goes wrong between shutter and estimator: late, at wrong stamps, lost, twice."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from tt_core.params import check, param

from ..render import Image
from .camera_sequence import Frame


@dataclass(frozen=True, slots=True)
class CameraFaults:
    """All zero is the perfect camera. latency and clock_offset do not change what is measured, only when."""

    latency: float = param(0.0, "s", "mean, from the exposure to the estimator", low=0.0, high=1.0)
    jitter: float = param(0.0, "s", "standard deviation of a stamp", low=0.0, high=0.01)
    clock_offset: float = param(0.0, "s", "by which the cameras' clock is ahead of the arm's", low=-1.0, high=1.0)
    apart: float = param(0.0, "s", "by which the right camera's stamps are ahead of the left one's", low=-0.01, high=0.01)
    dropped: float = param(0.0, "", "share of images that never come", low=0.0, high=1.0)
    duplicated: float = param(0.0, "", "share of images that come twice", low=0.0, high=1.0)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


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
