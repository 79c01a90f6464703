"""What the panels of the view show: latencies, diagnostics and camera images, as far as they have arrived."""

from __future__ import annotations

import json
import statistics
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from tt_core.arrays import Array

KEPT = 50  # latencies of each stage
MOST_NAMES = 60  # statuses that are kept
STALE = 5.0  # s after which a status that was not repeated is stale
IMAGE_KEPT = 1.0  # s for which a darker image does not replace a brighter one


@dataclass(frozen=True, slots=True)
class Health:
    """The newest status of one part of a node, which came at `time` (s). level: 0 OK, 1 warning, 2 error, 3 stale."""

    time: float
    name: str
    level: int
    message: str


class KeptImage(NamedTuple):
    """An image (h, w), the sum of its grey levels, and when it came, s."""

    image: np.ndarray
    brightness: float
    time: float


@dataclass
class Readings:
    """The newest of everything that is not in the 3D scene.

    Attributes:
        latencies: ms from the last frame to each stage, newest last, by the stage.
        health: By name.
        images: By camera.
        shown: What was last done for the user, or why not.
    """

    latencies: dict[str, deque[float]] = field(default_factory=dict)
    health: dict[str, Health] = field(default_factory=dict)
    images: dict[str, KeptImage] = field(default_factory=dict)
    shown: str = ""

    def take_latency(self, stage: str, milliseconds: float) -> None:
        """Take the latency (ms) of a stage."""
        self.latencies.setdefault(stage, deque(maxlen=KEPT)).append(milliseconds)

    def take_image(self, camera: str, image: np.ndarray, now: float) -> None:
        """Take an image (h, w) that came at `now` (s); of a burst the brightest is kept, in which most of the ball is seen."""
        new, kept = KeptImage(image, float(image.sum()), now), self.images.get(camera)
        if kept is None or new.brightness >= kept.brightness or not 0.0 <= now - kept.time < IMAGE_KEPT:
            self.images[camera] = new

    def take_health(self, statuses: Iterable[Health]) -> None:
        """Take statuses; the oldest names go when there are too many."""
        for status in statuses:
            self.health.pop(status.name, None)
            self.health[status.name] = status
        while len(self.health) > MOST_NAMES:
            del self.health[next(iter(self.health))]

    def health_at(self, now: float) -> list[Health]:
        """Return all statuses at `now` (s), the worst first; those that were not repeated are stale."""
        aged = [status if now - status.time < STALE else replace(status, level=3) for status in self.health.values()]
        return sorted(aged, key=lambda status: (-status.level, status.name))

    def median_latencies(self) -> list[tuple[str, float, float]]:
        """Return stage, newest latency and median latency, ms, in the order of the data."""
        rows = [(stage, values[-1], statistics.median(values)) for stage, values in self.latencies.items()]
        return sorted(rows, key=lambda row: row[2])


def landing_place(values: dict[str, str]) -> Array | None:
    """Return where a ball landed, (3,) m, from the values of a status "ball over"; None if it did not, or they hold no place."""
    try:
        row = json.loads(values.get("landing", "null"))
        place = np.array(row[1:4], dtype=float) if row else None
    except (ValueError, TypeError, KeyError):
        return None
    return place if place is not None and place.shape == (3,) and np.isfinite(place).all() else None
