"""Store of launches whose images are rendered before the ball flies."""

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

STORE = 2  # launches rendered ahead if balls are launched at a rate
RENDERING_PAUSE = 0.15  # s after the last image of a ball, in which nothing is rendered, because other nodes measure and plan then
STORE_CHECK_INTERVAL = 0.02  # s between two checks whether a launch must be rendered


class ReadyImage(NamedTuple):
    """An image that is ready to be published at its time.

    Attributes:
        due: s after the launch, when it is published.
        stamp: s after the launch, middle of the exposure by the clock of the cameras.
        side: Camera: 0 left, 1 right.
        message: The image in the form in which it is published.
    """

    due: float
    stamp: float
    side: int
    message: Any


@dataclass
class ReadyLaunch:
    """A launch, a ball that the launcher shoots, whose images are ready.

    Attributes:
        number: Counts the launches that have flown from 1; 0 before this one flies.
        shot: Kind and scale, e.g. "top 3".
        ball: The ball at the launch, with time 0.
        physics: True physics of this ball.
        images: Images that have not been published yet, in the order in which they are.
    """

    number: int
    shot: str
    ball: BallState
    physics: Physics
    images: deque[ReadyImage]


class LaunchStore:
    """Store of rendered launches, in the order in which they are to be flown.

    Attributes:
        shots: Kind and scale of the launches, taken in turn; may be changed at any time.
        ready: Rendered launches: STORE at most, or the one that was requested. The simulator's loop takes them from the left.
        last_image: s, monotonic clock, when the last image of a ball was published.
    """

    def __init__(self, renderer: LaunchRenderer, shots: list[tuple[str, int]], repeat: int, prepare: Callable[[DelayedImage], Any]) -> None:
        """Start the process that renders.

        Args:
            renderer: Launcher, cameras and faults for this process.
            shots: Kind and scale of the launches, taken in turn.
            repeat: Number of launches after which the same launches begin again; 0: never.
            prepare: Function that converts an image to the form in which it is published.
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
        """Render launches in advance until the simulator ends; to be run in a thread.

        Args:
            is_running: Tells whether the simulator still runs.
            is_wanted: Tells whether launches are rendered without a request.
            render: Called to render the next launch.
        """
        while is_running():
            if is_wanted() and len(self.ready) < STORE and time.monotonic() > self.last_image + RENDERING_PAUSE:
                render()
            else:
                time.sleep(STORE_CHECK_INTERVAL)

    def close(self) -> None:
        """End the process that renders."""
        self._worker.close()
