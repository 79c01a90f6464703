"""Publish the ball over time, followed by the wide cameras, with or without a measurement of the fast ones."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import Enum

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.node import Node
from std_msgs.msg import String
from tt_core.errors import TtError
from tt_core.learnt_physics import physics_from_text
from tt_core.params import check, param
from tt_core.priority import RESPONSE
from tt_core.ros.convert import ball_from_message, ball_to_message
from tt_core.ros.diagnostics import Event, Status
from tt_core.ros.inputs import Input
from tt_core.ros.node_main import run
from tt_core.ros.params import declare, declare_physics
from tt_core.ros.qos import LATCHED, RELIABLE
from tt_core.ros.refusals import Refusals
from tt_core.states import Array

from .rig import CLOCK_SPREAD, WIDE_BIAS, WIDE_NOISE, WIDE_SIDES, wide_pair
from .tracking import Tracker, TrackerParams
from .warm import warm_tracker
from .wide_inputs import WideInputs

LARGEST_PHYSICS = 1 << 15  # bytes: learnt coefficients have 3,000
LARGEST_STATE = 4096  # bytes: a state has 730


class TrackLine(Enum):
    """Messages that this node writes to the terminal."""

    FOLLOWED = "follows ball {number}: at x {x:.2f}, y {y:.2f}, z {z:.2f} m with {speed:.2f} m/s"


@dataclass(frozen=True)
class TrackParams:
    """What is known about the pixels."""

    pixel_noise: float = param(
        WIDE_NOISE, "pixels", "standard deviation of each pixel coordinate of the ball; of a centroid of 7 pixels 0.1", low=1e-3, high=100.0
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


class TrackNode(Node):
    """Subscribe to ball/first, ball/measured, camera/{wide_left,wide_right}/ball and camera_info, publish ball/state for each frame.

    The poses of the wide cameras are parameters, see `WideInputs`.
    """

    def __init__(self) -> None:
        """Declare parameters, compile the kernels, then subscribe."""
        super().__init__("track")
        self.noise = declare(self, TrackParams).pixel_noise
        self.params = declare(self, TrackerParams(camera_bias=WIDE_BIAS, clock_spread=CLOCK_SPREAD))
        self.physics = declare_physics(self)
        self.frame, self.sides = -np.inf, set[int]()  # s, of the newest frame, and the cameras that have seen the ball in it
        self.followed = 0  # balls that were found or measured
        warm_tracker(wide_pair())
        self.status = Status(self)
        self.states = self.create_publisher(Odometry, "ball/state", RELIABLE)
        self.bad_balls, self.bad_physics = Refusals(self.status, "measured ball"), Refusals(self.status, "physics")
        Input(self, String, "physics", self.on_physics, LATCHED, largest=LARGEST_PHYSICS, refused=self.bad_physics)
        self.wide = WideInputs(self, self.status, self.on_pixel, self.on_calibration)
        self.tracker = Tracker(self.physics, self.wide.cameras, self.params)
        inputs = list(self.wide.inputs)
        for topic in ("ball/first", "ball/measured"):
            inputs.append(Input(self, Odometry, topic, self.on_ball, RELIABLE, largest=LARGEST_STATE, refused=self.bad_balls))
        self.status.wait_for(inputs)

    def on_calibration(self) -> None:
        """Start anew with the cameras as they are now known to be."""
        self.tracker = Tracker(self.physics, self.wide.cameras, self.params)

    def on_physics(self, message: String) -> None:
        """Take learnt coefficients; they are used from the next measured ball on."""
        try:
            self.physics = physics_from_text(message.data, "track", self.physics)
        except TtError as error:
            self.bad_physics(error)

    def on_ball(self, message: Odometry) -> None:
        """Start anew from a measured ball, and publish it. The refined measurement of a ball replaces its first estimate."""
        try:
            ball = ball_from_message(message)
            self.tracker.use(self.physics)
            self.tracker.start(ball)
        except TtError as error:
            self.bad_balls(error)
            return
        self.publish()

    def on_pixel(self, time: float, side: int, pixel: Array) -> None:
        """Take a pixel, and publish the ball when both cameras have told theirs of a frame, or a newer frame begins."""
        if time > self.frame and self.sides and len(self.sides) < len(WIDE_SIDES):  # the other camera did not see the ball in that frame
            self.publish()
        self.tracker.add_pixel(time, side, pixel, self.noise)
        if time > self.frame or time < self.frame - self.params.lag:
            self.frame, self.sides = time, set()
        if time == self.frame:
            self.sides.add(side)
            if len(self.sides) == len(WIDE_SIDES):
                self.publish()

    def publish(self) -> None:
        """Publish the ball, if there is one, and tell of each new one."""
        ball = self.tracker.state()
        if ball is None:
            return
        self.states.publish(ball_to_message(ball))
        if self.tracker.counts.balls != self.followed:
            self.followed = self.tracker.counts.balls
            self.status.publish(Event.FOLLOWED, stamp=ball.time, **asdict(self.tracker.counts))
            x, y, z = ball.position
            self.status.terminal.info(TrackLine.FOLLOWED, number=self.followed, x=x, y=y, z=z, speed=float(np.linalg.norm(ball.velocity)))


def main() -> None:
    """Run the node."""
    run(TrackNode, RESPONSE)


if __name__ == "__main__":
    main()
