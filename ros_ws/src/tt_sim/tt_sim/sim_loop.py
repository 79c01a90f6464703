"""The simulator's loop, without ROS: ticks (steps) of arm and balls at multiples of a period, images at their stamps, and launches."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from heapq import heappop, heappush
from itertools import count
from typing import Any, Protocol

import numpy as np
from tt_arm.joints import Joints
from tt_core.clock_offsets import CLOCK_ROUNDING
from tt_core.states import Array, BallState

from .cameras.tracking_cameras import TrackedPixel, TrackingCameraPair, TrackingCameras
from .frame_schedule import FrameSchedule
from .launch_store import LaunchStore, ReadyLaunch
from .pace import Pace
from .sim_params import SimParams
from .simulated_robot import SimulatedRobot, Tick
from .world.arm_record import ArmRecord
from .world.drive import Drive
from .world.outcome import Outcome
from .world.plant import Plant
from .world_file import WorldParams

DRIVE_REPORT_INTERVAL = 0.25  # s, least time between two reports about the drives
HOLD = 0.005  # s between two checks whether simulated time continues
RECORD = 1.0  # s between two reports about the arm's record
MOST_FLYING = 8  # balls at a time; at 94 a minute there are three


class Outputs(Protocol):
    """Receiver of what the simulator produces; the thread of the loop calls its methods."""

    def publish_image(self, side: int, stamp: float, message: Any) -> None:
        """Take an image message of a camera.

        Args:
            side: Camera: 0 left, 1 right.
            stamp: s, middle of the exposure by the clock of the cameras.
            message: The image, in the form in which it is published.
        """

    def publish_clock(self, now: float) -> None:
        """Take the simulated time (s)."""

    def publish_ball(self, ball: BallState) -> None:
        """Take the state of a ball at its launch."""

    def publish_joints(self, joints: Joints, effort: Array) -> None:
        """Take the measured state of the joints, and the torques (n,) in N m of their motors."""

    def publish_truth(self, tick: Tick) -> None:
        """Take the true state of arm and ball at the end of a tick."""

    def wants_pixels(self) -> bool:
        """Tell whether any node needs the pixels of the wide cameras."""

    def publish_pixel(self, side: int, stamp: float, pixel: Array) -> None:
        """Take the pixel at which a wide camera saw the ball.

        Args:
            side: Camera: 0 left, 1 right.
            stamp: s, middle of the exposure.
            pixel: (2,) column and row of the ball's centre.
        """

    def report_drive(self, is_braking: bool) -> None:
        """Take whether the drives brake, because there is no valid command; called when this has changed."""

    def report_record(self, record: ArmRecord) -> None:
        """Take the extreme values of the true arm since the start."""

    def report_end(self, launch: ReadyLaunch, outcome: Outcome) -> None:
        """Take the result of a ball that has landed or is lost."""


class SimLoop:
    """Loop that runs the simulated robot in real time.

    Attributes:
        rate: Launches per minute. 0: a ball is launched as soon as it is ready, one at a time. May be changed at any time.
    """

    def __init__(
        self,
        params: SimParams,
        world: WorldParams,
        plant: Plant,
        drive: Drive,
        launches: LaunchStore,
        dark: Sequence[Any],
        outputs: Outputs,
    ) -> None:
        """Prepare the loop.

        Args:
            params: Parameters of the simulator.
            world: True physics and faults of the hardware.
            plant: The simulated arm.
            drive: The drives of the arm, which receive the commands.
            launches: Launches whose images are rendered.
            dark: An image without a ball for each camera, in the form in which it is published.
            outputs: Receiver of what the simulator produces.
        """
        self.rate = 0.0
        self._allowed = np.inf  # s, simulated time at which the loop stands still; may be in the past
        self._params, self._world, self._plant, self._drive, self._launches = params, world, plant, drive, launches
        self._dark, self._outputs = dark if params.always_on else (), outputs

    def run(self, is_running: Callable[[], bool]) -> None:
        """Simulate ticks and publish images at their times, until `is_running` returns False."""
        self._begin()
        pace, frames, robot, tick = self._pace, self._frames, self._robot, self._params.tick
        while is_running():
            pace.follow_system_clock()
            tick_due, frame_due = robot.joints.time + tick, frames.due
            due = min(tick_due, frame_due)
            if due > self._allowed + CLOCK_ROUNDING:
                pace.stand_still(due, HOLD)
                continue
            pace.sleep_until(due)
            if frame_due <= tick_due:
                self._publish_frame()
            else:
                self._publish_clock(tick_due)
                self._launch(tick_due)
                self._tick(tick_due)

    @property
    def paused(self) -> bool:
        """Whether simulated time is stopped, except for steps."""
        return self._allowed < np.inf

    def pause(self, on: bool) -> None:
        """Stop simulated time if `on`, else continue it. Another thread may call this method."""
        self._allowed = -np.inf if on else np.inf

    def step(self, duration: float) -> float:
        """Let stopped simulated time continue by `duration` (s).

        Returns:
            The simulated time at which it stops again, s.
        """
        self._allowed = max(self._allowed, self._robot.joints.time) + duration
        return self._allowed

    def _begin(self) -> None:
        params, world, model = self._params, self._world, self._plant.model
        self._pace = pace = Pace(params.rtf)
        start = pace.start
        self._robot = SimulatedRobot(world.physics, self._plant, Joints(start, model.waiting, np.zeros(len(model.names))), params.tick)
        self._encoder_noise = np.random.default_rng(params.seed + 1)  # another generator than that of the launches
        wide_noise = np.random.default_rng(params.seed + 2)
        self._tracking = TrackingCameras(
            TrackingCameraPair(world.tracking_cameras, wide_noise), world.physics.air.coefficients, start, wide_noise
        )
        self._pixels, self._seen = list[tuple[float, int, TrackedPixel]](), count()  # a heap of those on their way, by arrival (s)
        self._frames = FrameSchedule(self._dark, start)
        self._record, self._record_reported = ArmRecord(model, self._robot.joints), -np.inf
        self._flying, self._launch_time = dict[float, ReadyLaunch](), -np.inf  # by the time of launch
        self._numbers = count(1)  # of the launches
        self._is_braking, self._drive_reported = True, -np.inf
        self._clock_due = start

    def _publish_frame(self) -> None:
        if self._frames.shows_ball:
            self._launches.last_image = time.monotonic()
        for side, stamp, message in self._frames.pop():
            self._outputs.publish_image(side, stamp, message)

    def _publish_clock(self, now: float) -> None:
        if now >= self._clock_due:
            self._outputs.publish_clock(now)
            self._clock_due = now + 1.0 / self._params.clock_rate

    def _launch(self, now: float) -> None:
        """Launch the next ball if it is ready, its time has come and there is room in the air."""
        rate = self.rate
        period, most = (60.0 / rate, MOST_FLYING) if rate else (0.0, 1)
        if now + self._params.lead < self._launch_time + period or len(self._flying) >= most:
            return
        try:
            launch = self._launches.ready.popleft()
        except IndexError:
            return
        launch.number, self._launch_time = next(self._numbers), now + self._params.lead
        self._flying[self._launch_time] = launch
        self._frames.show(launch, self._launch_time)
        ball = BallState.from_vector(self._launch_time, launch.ball.vector)
        self._robot.launch(ball, launch.physics)
        self._outputs.publish_ball(ball)

    def _tick(self, due: float) -> None:
        outputs, robot, drive, now = self._outputs, self._robot, self._drive, time.monotonic()
        timeout = drive.params.command_timeout / self._params.rtf
        # while this process was held up, commands could not arrive: their age says nothing, and no joint state is published
        is_late = self._pace.late(due, now) > timeout
        command = drive.command(now, self._params.tick, robot.joints.qdot, -1.0 if is_late else timeout)
        if drive.braking != self._is_braking and now - self._drive_reported >= DRIVE_REPORT_INTERVAL:
            self._is_braking, self._drive_reported = drive.braking, now
            outputs.report_drive(drive.braking)
        before = robot.joints
        tick = robot.advance(command)
        if not is_late:
            outputs.publish_joints(self._plant.measured(tick.joints, self._encoder_noise), self._plant.effort(before, tick.joints))
        if self._record.note(tick.joints) or now - self._record_reported > RECORD:
            self._record_reported = now
            outputs.report_record(self._record)
        outputs.publish_truth(tick)
        self._publish_pixels(tick)
        for outcome in tick.ended:
            outputs.report_end(self._flying.pop(outcome.launched.time), outcome)

    def _publish_pixels(self, tick: Tick) -> None:
        for seen in self._tracking.frames(tick, self._outputs.wants_pixels()):
            heappush(self._pixels, (seen.arrival, next(self._seen), seen))
        while self._pixels and self._pixels[0][0] <= tick.joints.time:
            _, _, seen = heappop(self._pixels)
            self._outputs.publish_pixel(seen.side, seen.stamp, seen.pixel)
