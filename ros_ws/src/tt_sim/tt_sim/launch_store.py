"""Launches that are rendered ahead, so that a ball's images are ready before it flies."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from tt_core.physics import Physics
from tt_core.states import BallState

from .cameras.render_worker import DelayedImage, LaunchRenderer, RenderWorker

STORE = 2  # launches rendered ahead, at a rate
QUIET = 0.15  # s after a burst in which nothing is rendered: then others measure and plan
PAUSE = 0.02  # s between two looks whether something is to be rendered


class ReadyImage(NamedTuple):
    """An image that waits for its time.

    Attributes:
        due: s after the launch, when it leaves.
        stamp: s after the launch.
        side: Of the camera, 0 left, 1 right.
        message: The image in the form in which it is published.
    """

    due: float
    stamp: float
    side: int
    message: Any


@dataclass
class ReadyLaunch:
    """A launch whose images are ready.

    Attributes:
        number: Counts the launches that have flown from 1; 0 before this one flies.
        shot: Kind and scale, e.g. "top 3".
        ball: At the launch, time 0.
        physics: Of this ball.
        images: Those that have not left yet, in the order in which they do.
    """

    number: int
    shot: str
    ball: BallState
    physics: Physics
    images: deque[ReadyImage]


class LaunchStore:
    """Rendered launches, in the order in which they are flown.

    Attributes:
        shots: Kind and scale of the launches, in turn; may be changed at any time.
        ready: STORE launches at most, or the one on request. The simulator's loop takes them from the left.
        last_image: s, monotonic clock, when the last image of a ball left.
    """

    def __init__(self, renderer: LaunchRenderer, shots: list[tuple[str, int]], repeat: int, prepare: Callable[[DelayedImage], Any]) -> None:
        """Start the process that renders.

        Args:
            renderer: What it does.
            shots: Kind and scale of the launches, in turn.
            repeat: Launches after which the same ones begin again; 0: never.
            prepare: Makes the message of an image.
        """
        self.shots, self.ready, self.last_image = shots, deque[ReadyLaunch](), float("-inf")
        self._renderer, self._repeat, self._prepare = renderer, repeat, prepare
        self._worker = RenderWorker(renderer)
        self._rendered, self._version = 0, 0  # _version: increased by `discard`
        self._worker_lock = threading.Lock()  # two threads render: ahead, and on request

    @property
    def next_shot(self) -> tuple[str, int]:
        """Kind and scale of the launch that is rendered next."""
        number = self._rendered % self._repeat if self._repeat else self._rendered
        return self.shots[number % len(self.shots)]

    def render(self) -> None:
        """Render the next launch, and wait for it. It is dropped if `discard` is called meanwhile.

        Raises:
            EOFError: The process that renders has ended, though the store was not closed.
        """
        version = self._version
        with self._worker_lock:
            if self._repeat and self._rendered and self._rendered % self._repeat == 0:
                self._worker.close()
                self._worker = RenderWorker(self._renderer)
            kind, scale = self.next_shot
            self._rendered += 1
            launch = self._worker.render(kind, scale)
        if launch is None or version != self._version:
            return
        images = deque(ReadyImage(image.due, image.stamp, image.side, self._prepare(image)) for image in launch.images)
        self.ready.append(ReadyLaunch(0, f"{kind} {scale}", launch.ball, launch.physics, images))

    def discard(self) -> None:
        """Drop what was rendered ahead, so that a change of the shots or of the rate holds from the next launch on."""
        self._version += 1
        self.ready.clear()

    def keep_full(self, is_running: Callable[[], bool], is_wanted: Callable[[], bool], render: Callable[[], None]) -> None:
        """Render ahead for as long as the simulator runs.

        Args:
            is_running: Whether it goes on.
            is_wanted: Whether launches are rendered without a request.
            render: What to call for the next launch.
        """
        while is_running():
            if is_wanted() and len(self.ready) < STORE and time.monotonic() > self.last_image + QUIET:
                render()
            else:
                time.sleep(PAUSE)

    def close(self) -> None:
        """End the process that renders."""
        self._worker.close()
