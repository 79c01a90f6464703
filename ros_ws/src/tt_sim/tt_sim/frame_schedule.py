"""When images leave: those of the launched ball at their times, and dark ones in between if cameras are always on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from tt_vision.rig import FRAME_RATE

from .launch_store import ReadyLaunch


class FrameSchedule:
    """The images to come.

    Attributes:
        due: s, when the next image leaves; inf when none does.
        shows_ball: Whether it is one of the launched ball.
    """

    def __init__(self, dark: Sequence[Any], start: float) -> None:
        """Begin without a ball.

        Args:
            dark: The image without a ball of each camera; empty for cameras that publish balls only.
            start: s, of the first dark frame.
        """
        self._dark = dark
        self._launch: ReadyLaunch | None = None
        self._launch_time = -math.inf
        self._dark_due = start if dark else math.inf

    def show(self, launch: ReadyLaunch, time: float) -> None:
        """Let the images of a launch at `time` (s) follow."""
        self._launch, self._launch_time = launch, time

    @property
    def shows_ball(self) -> bool:
        """Whether the next image is one of the launched ball."""
        return self._launch is not None and bool(self._launch.images)

    @property
    def due(self) -> float:
        """When the next image leaves, s; inf when there is none."""
        launch = self._launch
        return self._launch_time + launch.images[0].due if launch is not None and launch.images else self._dark_due

    def pop(self) -> list[tuple[int, float, Any]]:
        """Return camera, stamp (s) and message of what leaves next: an image of the ball, or a dark one of each camera."""
        due, launch = self.due, self._launch
        if self._dark:
            self._dark_due = due + 1.0 / FRAME_RATE
        if launch is not None and launch.images:
            image = launch.images.popleft()
            return [(image.side, self._launch_time + image.stamp, image.message)]
        return [(side, due, message) for side, message in enumerate(self._dark)]
