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
from tt_core.priority import set_priority
from tt_core.states import BallState
from tt_vision.rig import high_speed_pair

from ..domain_randomization import DomainRandomization
from ..render import Image, Scene, Texture
from ..world.launcher import LauncherParams, launch
from .camera_faults import CameraFaults, arrivals
from .camera_sequence import camera_sequence

NICE = 10  # by which it steps back: a launch that is late is launched later, a node that is late has missed the ball
GUARD = ("setpriv", "--pdeathsig", "KILL") if shutil.which("setpriv") else ()  # the kernel ends it with its parent, rendering or not


@dataclass(frozen=True, slots=True, eq=False)
class DelayedImage:
    """An image on its way: when it arrives and its stamp, both s after the launch, and which camera took it."""

    due: float
    stamp: float
    side: int
    image: Image


@dataclass(frozen=True, slots=True, eq=False)
class RenderedLaunch:
    """One launch. ball: at the launch, time 0. physics: of this ball. shown: in the order in which they arrive."""

    ball: BallState
    physics: Physics
    shown: list[DelayedImage]


@dataclass(frozen=True)
class LaunchRenderer:
    """Catapult, cameras and what goes wrong in them. seed: of the marks, and of all that is drawn."""

    seed: int = 0
    launcher: LauncherParams = field(default_factory=LauncherParams)
    physics: Physics = field(default_factory=Physics.liu)
    domain_randomization: DomainRandomization = field(default_factory=DomainRandomization)
    faults: CameraFaults = field(default_factory=CameraFaults)

    def take(self, kind: str, scale: int, scene: Scene, rng: np.random.Generator) -> RenderedLaunch:
        """The next launch."""
        ball, orientation = launch(kind, scale, self.launcher, rng)
        physics, faults = self.domain_randomization.draw(self.physics, rng), self.faults
        frames = camera_sequence(ball, orientation, high_speed_pair(), scene, physics, rng)
        shown = [
            DelayedImage(stamp - faults.clock_offset + faults.latency, stamp, side, image)
            for side, stamp, image in arrivals(frames, faults, rng)
        ]
        return RenderedLaunch(ball, physics, sorted(shown, key=lambda one: one.due))


class RenderWorker:
    """The process that works in a studio."""

    def __init__(self, studio: LaunchRenderer) -> None:
        command = (*GUARD, sys.executable, "-m", __name__)
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True)
        self._closed = False
        self._send(studio)

    def take(self, kind: str, scale: int) -> RenderedLaunch | None:
        """Waits for it; None once closed. Raises EOFError when the process has ended."""
        try:
            self._send((kind, scale))
            take: RenderedLaunch = pickle.load(self._process.stdout)  # type: ignore[arg-type]
            return take
        except (OSError, EOFError, pickle.UnpicklingError) as error:
            if self._closed:
                return None
            raise EOFError("the process that renders has ended") from error

    def close(self) -> None:
        self._closed = True
        self._process.kill()
        self._process.wait()

    def _send(self, order: object) -> None:
        pickle.dump(order, self._process.stdin)  # type: ignore[arg-type]
        self._process.stdin.flush()  # type: ignore[union-attr]


def main() -> None:
    set_priority(NICE)  # the simulator itself runs above the usual priority
    try:
        studio: LaunchRenderer = pickle.load(sys.stdin.buffer)
        scene, rng = Scene(texture=Texture.drawn(studio.seed)), np.random.default_rng(studio.seed)
        while True:
            kind, scale = pickle.load(sys.stdin.buffer)
            take = studio.take(kind, scale, scene, rng)
            pickle.dump(take, sys.stdout.buffer, pickle.HIGHEST_PROTOCOL)
            sys.stdout.buffer.flush()
    except (EOFError, BrokenPipeError, pickle.UnpicklingError):  # an order that was cut short is unpickled to the last
        os._exit(0)  # without a last try to flush


if __name__ == "__main__":
    main()
