"""Times at which images are published: those of a launched ball, and images without a ball in between if the cameras are always on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from tt_vision.rig import FRAME_RATE

from .launch_store import ReadyLaunch


class FrameSchedule:
    """Schedule of the images that are still to be published.

    Attributes:
        due: s, when the next image is published; inf if there is none.
        shows_ball: Whether the next image shows the launched ball.
    """

    def __init__(self, dark: Sequence[Any], start: float) -> None:
        """Start without a ball.

        Args:
            dark: The image without a ball of each camera; empty if the cameras publish images with a ball only.
            start: s, time of the first image without a ball.
        """
        self._dark = dark
        self._launch: ReadyLaunch | None = None
        self._launch_time = -math.inf
        self._dark_due = start if dark else math.inf

    def show(self, launch: ReadyLaunch, time: float) -> None:
        """Add the images of a launch at `time` (s), in place of those of the launch before."""
        self._launch, self._launch_time = launch, time

    @property
    def shows_ball(self) -> bool:
        """Whether the next image is one of the launched ball."""
        return self._launch is not None and bool(self._launch.images)

    @property
    def due(self) -> float:
        """Time when the next image is published, s; inf if there is none."""
        launch = self._launch
        return self._launch_time + launch.images[0].due if launch is not None and launch.images else self._dark_due

    def pop(self) -> list[tuple[int, float, Any]]:
        """Remove the next images: one of the ball, or one without a ball for each camera.

        Returns:
            Camera (0 left, 1 right), stamp (s) and message of each.
        """
        due, launch = self.due, self._launch
        if self._dark:
            self._dark_due = due + 1.0 / FRAME_RATE
        if launch is not None and launch.images:
            image = launch.images.popleft()
            return [(image.side, self._launch_time + image.stamp, image.message)]
        return [(side, due, message) for side, message in enumerate(self._dark)]
