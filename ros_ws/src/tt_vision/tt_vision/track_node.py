"""ROS node that publishes the state of the ball over time, tracked with the wide cameras.

A measurement by the high speed cameras starts a track. It is not needed: the ball is also found in the pixels of the wide cameras alone.
"""

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
from tt_core.ros.inputs import PHYSICS_FORM, STATE_FORM, Input
from tt_core.ros.node_main import run
from tt_core.ros.params import declare, declare_physics
from tt_core.ros.qos import LATCHED, RELIABLE
from tt_core.ros.refusals import Refusals
from tt_core.states import Array

from .rig import CLOCK_SPREAD, WIDE_BIAS, WIDE_NOISE, WIDE_SIDES, wide_pair
from .tracking import Tracker, TrackerParams
from .warm import warm_tracker
from .wide_inputs import WideInputs


class TrackLine(Enum):
    """Messages that this node writes to the terminal."""

    FOLLOWED = "follows ball {number}: at x {x:.2f}, y {y:.2f}, z {z:.2f} m with {speed:.2f} m/s"


@dataclass(frozen=True)
class TrackParams:
    """Parameters of the node: accuracy of the pixels at which the wide cameras see the ball."""

    pixel_noise: float = param(
        WIDE_NOISE, "pixels", "standard deviation of each pixel coordinate of the ball; of a centroid of 7 pixels 0.1", low=1e-3, high=100.0
    )

    def __post_init__(self) -> None:
        """Raise an error for a value outside its range."""
        check(self)


class TrackNode(Node):
    """Node that tracks the ball and publishes its state on ball/state, once for each frame (image instant) of the wide cameras.

    It subscribes to camera/{wide_left,wide_right}/ball and camera_info (the pixels at which the wide cameras see the ball, and their
    intrinsics), to ball/first and ball/measured (measurements by the high speed cameras, which start a track), and to physics (learnt
    coefficients). The poses of the wide cameras are parameters, see `WideInputs`.
    """

    def __init__(self) -> None:
        """Declare the parameters, compile the functions of the tracker, then subscribe to the topics."""
        super().__init__("track")
        self.noise = declare(self, TrackParams).pixel_noise
        self.params = declare(self, TrackerParams(camera_bias=WIDE_BIAS, clock_spread=CLOCK_SPREAD))
        self.physics = declare_physics(self)
        self.frame, self.sides = -np.inf, set[int]()  # time of the newest frame, s, and the cameras that have seen the ball in it
        self.followed = 0  # number of balls that were found or measured
        warm_tracker(wide_pair())
        self.status = Status(self)
        self.states = self.create_publisher(Odometry, "ball/state", RELIABLE)
        self.bad_balls, self.bad_physics = Refusals(self.status, "measured ball"), Refusals(self.status, "physics")
        Input(self, PHYSICS_FORM, "physics", self.on_physics, LATCHED, refused=self.bad_physics)
        self.wide = WideInputs(self, self.status, self.on_pixel, self.on_calibration)
        self.tracker = Tracker(self.physics, self.wide.cameras, self.params)
        inputs = list(self.wide.inputs)
        for topic in ("ball/first", "ball/measured"):
            inputs.append(Input(self, STATE_FORM, topic, self.on_ball, RELIABLE, refused=self.bad_balls))
        self.status.wait_for(inputs)

    def on_calibration(self) -> None:
        """Replace the tracker by a new one for the changed cameras; the present track is lost."""
        self.tracker = Tracker(self.physics, self.wide.cameras, self.params)

    def on_physics(self, message: String) -> None:
        """Store learnt coefficients of the physics; they are used from the next measured ball on.

        Args:
            message: The coefficients as text, see `tt_core.learnt_physics`.
        """
        try:
            self.physics = physics_from_text(message.data, "track", self.physics)
        except TtError as error:
            self.bad_physics(error)

    def on_ball(self, message: Odometry) -> None:
        """Start a new track from a measured ball, and publish its state. So a measurement of a ball replaces its first estimate.

        Args:
            message: The measured state.
        """
        try:
            ball = ball_from_message(message)
            self.tracker.use(self.physics)
            self.tracker.start(ball)
        except TtError as error:
            self.bad_balls(error)
            return
        self.publish()

    def on_pixel(self, time: float, side: int, pixel: Array) -> None:
        """Add a pixel to the tracker; publish the ball when the pixels of both cameras in a frame have arrived, or a newer frame begins.

        Args:
            time: s, stamp of the frame.
            side: Which camera, 0 left, 1 right.
            pixel: (2,) pixels, column and row of the ball.
        """
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
        """Publish the state of the ball, if there is one; report each new ball in the diagnostics."""
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
