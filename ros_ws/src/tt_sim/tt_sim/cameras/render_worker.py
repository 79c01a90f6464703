"""Rendering of launched balls in a process of its own, so that rendering does not delay the simulator.

`python -m tt_sim.cameras.render_worker` reads pickles from its standard input: first a LaunchRenderer, then kind and scale of each shot. It
writes a pickled RenderedLaunch for each shot. It runs at a lower priority and in a session of its own, so that Ctrl-C in a terminal does
not reach it, and it ends when its input ends, which also happens when the process that started it ends.
"""

from __future__ import annotations

import os
import pickle
import shutil
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np
from tt_core.arrays import Image
from tt_core.physics import Physics
from tt_core.priority import reset_nice, set_nice
from tt_core.states import BallState
from tt_vision.rig import high_speed_pair

from ..domain_randomization import DomainRandomization
from ..render import Scene, Texture
from ..world.launcher import LauncherParams, launch
from .camera_faults import CameraFaults, arrivals
from .camera_sequence import camera_sequence

CLOSE_TIMEOUT = 0.5  # s, at most, that `close` waits until the killed process has ended
NICE = 10  # lower priority than nodes have: a launch that is rendered late flies later, but a node that is late misses the ball
KILL_WITH_PARENT = ("setpriv", "--pdeathsig", "KILL") if shutil.which("setpriv") else ()  # the kernel ends the process with its parent


@dataclass(frozen=True, slots=True, eq=False)
class DelayedImage:
    """An image, and the time at which it arrives.

    Attributes:
        due: s after the launch, when it arrives.
        stamp: s after the launch, middle of the exposure by the clock of the cameras.
        side: Camera: 0 left, 1 right.
        image: (h, w) grey levels.
    """

    due: float
    stamp: float
    side: int
    image: Image


@dataclass(frozen=True, slots=True, eq=False)
class RenderedLaunch:
    """One launched ball and its images.

    Attributes:
        ball: The ball at the launch, with time 0.
        physics: True physics of this ball.
        images: Images in the order in which they arrive.
    """

    ball: BallState
    physics: Physics
    images: list[DelayedImage]


@dataclass(frozen=True)
class LaunchRenderer:
    """Launcher, cameras and their faults: all that is needed to render launched balls.

    Attributes:
        seed: Seed of the marks on the ball, and of all random numbers.
        launcher: Parameters of the launcher.
        physics: Mean physics of the balls.
        domain_randomization: Random differences of the physics from ball to ball.
        faults: Faults of the cameras.
    """

    seed: int = 0
    launcher: LauncherParams = field(default_factory=LauncherParams)
    physics: Physics = field(default_factory=Physics.liu)
    domain_randomization: DomainRandomization = field(default_factory=DomainRandomization)
    faults: CameraFaults = field(default_factory=CameraFaults)

    def render(self, kind: str, scale: int, scene: Scene, rng: np.random.Generator) -> RenderedLaunch:
        """Draw a launch at random and render its images.

        Args:
            kind: Kind of the shot, as for `tt_sim.world.launcher.launch`.
            scale: Scale of the shot, as for `launch`.
            scene: Marks, light and sensor.
            rng: Random numbers.
        """
        ball, orientation = launch(kind, scale, self.launcher, rng)
        physics, faults = self.domain_randomization.draw(self.physics, rng), self.faults
        frames = camera_sequence(ball, orientation, high_speed_pair(), scene, physics, rng)
        images = [
            DelayedImage(stamp - faults.clock_offset + faults.latency, stamp, side, image)
            for side, stamp, image in arrivals(frames, faults, rng)
        ]
        return RenderedLaunch(ball, physics, sorted(images, key=lambda image: image.due))


class RenderWorker:
    """A process that renders launched balls on request."""

    def __init__(self, renderer: LaunchRenderer) -> None:
        """Start the process.

        Args:
            renderer: Launcher, cameras and faults.
        """
        command = (*KILL_WITH_PARENT, sys.executable, "-m", __name__)
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True)
        self._closed = False
        self._send(renderer)

    def render(self, kind: str, scale: int) -> RenderedLaunch | None:
        """Request a launch and wait until it is rendered.

        Args:
            kind: Kind of the shot, as for `tt_sim.world.launcher.launch`.
            scale: Scale of the shot, as for `launch`.

        Returns:
            The launch; None if the worker was closed meanwhile.

        Raises:
            EOFError: The process has ended by itself.
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
        """Kill the process. Its priority is raised first: at the low one it would take seconds to end on a busy machine."""
        self._closed = True
        if self._process.poll() is not None:
            return
        reset_nice(self._process.pid)
        self._process.kill()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(CLOSE_TIMEOUT)

    def _send(self, order: object) -> None:
        pickle.dump(order, self._process.stdin)  # type: ignore[arg-type]
        self._process.stdin.flush()  # type: ignore[union-attr]


def main() -> None:
    """Render the launches that are requested on standard input, until it ends."""
    set_nice(NICE)  # the simulator itself runs above the usual priority
    launches = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints must not get between the launches
    try:
        renderer: LaunchRenderer = pickle.load(sys.stdin.buffer)
        scene, rng = Scene(texture=Texture.drawn(renderer.seed)), np.random.default_rng(renderer.seed)
        while True:
            kind, scale = pickle.load(sys.stdin.buffer)
            pickle.dump(renderer.render(kind, scale, scene, rng), launches, pickle.HIGHEST_PROTOCOL)
            launches.flush()
    except (EOFError, BrokenPipeError, pickle.UnpicklingError):  # an order that was cut short is unpickled to the last
        os._exit(0)  # without a last try to flush


if __name__ == "__main__":
    main()
