"""Render launches and their images in a process of its own, so that rendering does not delay the deadlines of the simulator.

`python -m tt_sim.cameras.render_worker` reads pickles from its standard input: first a LaunchRenderer, then kind and scale of each shot. It
writes a pickled RenderedLaunch for each. It runs at a lower priority and in a session of its own, so that Ctrl-C in a terminal does not
reach it, and it ends when its input ends, which also happens when the process that started it ends.
"""

from __future__ import annotations

import os
import pickle
import shutil
import subprocess
import sys
from dataclasses import dataclass, field

import numpy as np
from tt_core.physics import Physics
from tt_core.priority import set_nice
from tt_core.states import BallState
from tt_vision.rig import high_speed_pair

from ..domain_randomization import DomainRandomization
from ..render import Image, Scene, Texture
from ..world.launcher import LauncherParams, launch
from .camera_faults import CameraFaults, arrivals
from .camera_sequence import camera_sequence

NICE = 10  # a late launch is only launched later, but a late node has missed the ball
GUARD = ("setpriv", "--pdeathsig", "KILL") if shutil.which("setpriv") else ()  # the kernel ends the process with its parent


@dataclass(frozen=True, slots=True, eq=False)
class DelayedImage:
    """An image on its way.

    Attributes:
        due: s after the launch, when it arrives.
        stamp: s after the launch.
        side: Of the camera, 0 left, 1 right.
        image: (h, w).
    """

    due: float
    stamp: float
    side: int
    image: Image


@dataclass(frozen=True, slots=True, eq=False)
class RenderedLaunch:
    """One launch and its images.

    Attributes:
        ball: At the launch, time 0.
        physics: Of this ball.
        images: In the order in which they arrive.
    """

    ball: BallState
    physics: Physics
    images: list[DelayedImage]


@dataclass(frozen=True)
class LaunchRenderer:
    """Launcher, cameras and their faults.

    Attributes:
        seed: Of the marks on the ball, and of all random numbers.
        launcher: Where it stands and how it scatters.
        physics: Of balls without randomization.
        domain_randomization: How balls differ.
        faults: Of the cameras.
    """

    seed: int = 0
    launcher: LauncherParams = field(default_factory=LauncherParams)
    physics: Physics = field(default_factory=Physics.liu)
    domain_randomization: DomainRandomization = field(default_factory=DomainRandomization)
    faults: CameraFaults = field(default_factory=CameraFaults)

    def render(self, kind: str, scale: int, scene: Scene, rng: np.random.Generator) -> RenderedLaunch:
        """Render one launch, of a kind and scale as of `launch`."""
        ball, orientation = launch(kind, scale, self.launcher, rng)
        physics, faults = self.domain_randomization.draw(self.physics, rng), self.faults
        frames = camera_sequence(ball, orientation, high_speed_pair(), scene, physics, rng)
        images = [
            DelayedImage(stamp - faults.clock_offset + faults.latency, stamp, side, image)
            for side, stamp, image in arrivals(frames, faults, rng)
        ]
        return RenderedLaunch(ball, physics, sorted(images, key=lambda image: image.due))


class RenderWorker:
    """A process that renders launches."""

    def __init__(self, renderer: LaunchRenderer) -> None:
        """Start it; renderer: what it does."""
        command = (*GUARD, sys.executable, "-m", __name__)
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True)
        self._closed = False
        self._send(renderer)

    def render(self, kind: str, scale: int) -> RenderedLaunch | None:
        """Wait for the next launch.

        Args:
            kind: As of `launch`.
            scale: As of `launch`.

        Returns:
            The launch; None once the worker is closed.

        Raises:
            EOFError: The process has ended.
        """
        try:
            self._send((kind, scale))
            rendered: RenderedLaunch = pickle.load(self._process.stdout)  # type: ignore[arg-type]
            return rendered
        except (OSError, EOFError, pickle.UnpicklingError) as error:
            if self._closed:
                return None
            raise EOFError("the process that renders has ended") from error

    def close(self) -> None:
        """End the process."""
        self._closed = True
        self._process.kill()
        self._process.wait()

    def _send(self, order: object) -> None:
        pickle.dump(order, self._process.stdin)  # type: ignore[arg-type]
        self._process.stdin.flush()  # type: ignore[union-attr]


def main() -> None:
    """Render until the input ends."""
    set_nice(NICE)  # the simulator itself runs above the usual priority
    try:
        renderer: LaunchRenderer = pickle.load(sys.stdin.buffer)
        scene, rng = Scene(texture=Texture.drawn(renderer.seed)), np.random.default_rng(renderer.seed)
        while True:
            kind, scale = pickle.load(sys.stdin.buffer)
            pickle.dump(renderer.render(kind, scale, scene, rng), sys.stdout.buffer, pickle.HIGHEST_PROTOCOL)
            sys.stdout.buffer.flush()
    except (EOFError, BrokenPipeError, pickle.UnpicklingError):  # an order that was cut short is unpickled to the last
        os._exit(0)  # without a last try to flush


if __name__ == "__main__":
    main()
