"""Data that the panels of the live view show: the newest latencies, diagnostics and camera images."""

from __future__ import annotations

import statistics
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

KEPT_LATENCIES = 50  # number of newest latencies that are kept of each stage
MOST_NAMES = 60  # most statuses that are kept
STALE = 5.0  # s without repetition, after which a status is stale
IMAGE_KEPT = 1.0  # s during which a darker image does not replace a brighter one


@dataclass(frozen=True, slots=True)
class Health:
    """A diagnostic status of a node or of a part of it.

    Attributes:
        time: Time of arrival, s.
        name: Name of the node, followed by ": part" if the status is about a part of it.
        level: 0 OK, 1 warning, 2 error, 3 stale.
        message: Text for people.
    """

    time: float
    name: str
    level: int
    message: str


class KeptImage(NamedTuple):
    """A camera image that is kept to be shown.

    Attributes:
        image: (h, w) grey levels, uint8 or uint16.
        brightness: Sum of its grey levels.
        time: Time of arrival, s.
    """

    image: np.ndarray
    brightness: float
    time: float


@dataclass
class Readings:
    """The newest data of everything that is shown beside the 3D scene.

    Attributes:
        latencies: Times from the last camera frame to the end of a stage, ms, the newest last, by stage.
        health: Newest status of each node or part, by name.
        images: Image that is shown of each camera, by camera.
        shown: Message about the last action of a user: what was done, or why not.
    """

    latencies: dict[str, deque[float]] = field(default_factory=dict)
    health: dict[str, Health] = field(default_factory=dict)
    images: dict[str, KeptImage] = field(default_factory=dict)
    shown: str = ""

    def take_latency(self, stage: str, milliseconds: float) -> None:
        """Add a latency (ms) of a stage, e.g. "measured"."""
        self.latencies.setdefault(stage, deque(maxlen=KEPT_LATENCIES)).append(milliseconds)

    def take_image(self, camera: str, image: np.ndarray, now: float) -> None:
        """Keep a camera image, unless a brighter one arrived less than IMAGE_KEPT s before.

        Thus the brightest image of a burst (the images of one ball) is kept, in which most of the ball is seen.

        Args:
            camera: Name of the camera.
            image: (h, w) grey levels, uint8 or uint16.
            now: Time of arrival, s.
        """
        new, kept = KeptImage(image, float(image.sum()), now), self.images.get(camera)
        if kept is None or new.brightness >= kept.brightness or not 0.0 <= now - kept.time < IMAGE_KEPT:
            self.images[camera] = new

    def take_health(self, statuses: Iterable[Health]) -> None:
        """Keep statuses, each in place of the older one of its name. Above MOST_NAMES names, those not updated for longest are dropped."""
        for status in statuses:
            self.health.pop(status.name, None)
            self.health[status.name] = status
        while len(self.health) > MOST_NAMES:
            del self.health[next(iter(self.health))]

    def health_at(self, now: float) -> list[Health]:
        """Return all statuses, the worst first. Those that have not been repeated for STALE s at the time `now` (s) get the level stale."""
        aged = [status if now - status.time < STALE else replace(status, level=3) for status in self.health.values()]
        return sorted(aged, key=lambda status: (-status.level, status.name))

    def median_latencies(self) -> list[tuple[str, float, float]]:
        """Return a row for each stage: its name, its newest latency and its median latency (ms), sorted by the median."""
        rows = [(stage, values[-1], statistics.median(values)) for stage, values in self.latencies.items()]
        return sorted(rows, key=lambda row: row[2])
