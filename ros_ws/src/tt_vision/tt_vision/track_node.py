"""Publish the ball over time, followed by the wide cameras, with or without a measurement of the fast ones."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial

import numpy as np
from geometry_msgs.msg import PointStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo
from std_msgs.msg import String
from tt_core.errors import TtError
from tt_core.learnt_physics import physics_from_text
from tt_core.params import check, param
from tt_core.ros.convert import ball_from_message, ball_to_message, camera_from_message, pixel_from_message
from tt_core.ros.diagnostics import Event, Status
from tt_core.ros.inputs import Input
from tt_core.ros.node_main import run
from tt_core.ros.params import declare, declare_physics
from tt_core.ros.qos import LATCHED, RELIABLE, SENSOR
from tt_core.ros.refusals import Refusals

from .camera import Camera
from .camera_pose import CameraPose
from .rig import CLOCK_SPREAD, WIDE_BIAS, WIDE_NOISE, WIDE_SIDES, wide_pair
from .tracking import Tracker, TrackerParams
from .warm import warm_tracker

NICE = -5  # priority of the process: the ball does not wait; only arm and hardware are more urgent
LARGEST_PIXEL = 1024  # bytes: one has 60
LARGEST_PHYSICS = 1 << 15  # bytes: learnt coefficients have 3,000
LARGEST_INFO = 4096  # bytes: one with 14 coefficients has 500
LARGEST_STATE = 4096  # bytes: a state has 730


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

    The poses of the cameras are the parameters {wide_left,wide_right}.rotation and .translation.
    """

    def __init__(self) -> None:
        """Declare parameters, compile the kernels, then subscribe."""
        super().__init__("track")
        self.noise = declare(self, TrackParams).pixel_noise
        self.params = declare(self, TrackerParams(camera_bias=WIDE_BIAS, clock_spread=CLOCK_SPREAD))
        self.physics = declare_physics(self)
        self.cameras: list[Camera] = list(wide_pair())
        self.poses = [declare(self, CameraPose.of(c), f"{name}.") for name, c in zip(WIDE_SIDES, self.cameras, strict=True)]
        self.infos: list[CameraInfo | None] = [None, None]
        self.tracker = Tracker(self.physics, self.cameras, self.params)
        self.frame, self.sides = -np.inf, set[int]()  # s, of the newest frame, and the cameras that have seen the ball in it
        self.followed = 0  # balls that were found or measured
        warm_tracker(self.cameras)
        self.status = Status(self)
        self.states = self.create_publisher(Odometry, "ball/state", RELIABLE)
        self.bad_balls, self.bad_pixels = Refusals(self.status, "measured ball"), Refusals(self.status, "pixel")
        self.bad_infos = Refusals(self.status, "camera_info of a wide camera")
        self.bad_physics = Refusals(self.status, "physics")
        Input(self, String, "physics", self.on_physics, LATCHED, largest=LARGEST_PHYSICS, refused=self.bad_physics)
        inputs = list[Input]()
        for side, name in enumerate(WIDE_SIDES):
            info, pixel = f"camera/{name}/camera_info", f"camera/{name}/ball"
            on_info, on_pixel = partial(self.on_info, side), partial(self.on_pixel, side)
            inputs.append(Input(self, CameraInfo, info, on_info, LATCHED, largest=LARGEST_INFO, refused=self.bad_infos))
            inputs.append(Input(self, PointStamped, pixel, on_pixel, SENSOR, largest=LARGEST_PIXEL, refused=self.bad_pixels))
        for topic in ("ball/first", "ball/measured"):
            inputs.append(Input(self, Odometry, topic, self.on_ball, RELIABLE, largest=LARGEST_STATE, refused=self.bad_balls))
        self.status.wait_for(inputs)

    def on_info(self, side: int, message: CameraInfo) -> None:
        """Take the calibration of a camera, unless it is the same as before. The tracker starts anew with it."""
        message.header = CameraInfo().header  # drivers send the same calibration again and again
        if message == self.infos[side]:
            return
        try:
            width, height, matrix, distortion = camera_from_message(message)
            old, pose = self.cameras[side], self.poses[side]
            camera = Camera.from_matrix(old.rotation, old.translation, matrix, width, height, distortion, old.pixel_size)
            self.cameras[side], self.infos[side] = pose.placed(camera), message
        except TtError as error:
            self.bad_infos(error)
            return
        self.tracker = Tracker(self.physics, self.cameras, self.params)

    def on_physics(self, message: String) -> None:
        """Use learnt coefficients from the next measured ball on."""
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

    def on_pixel(self, side: int, message: PointStamped) -> None:
        """Take a pixel, and publish the ball when both cameras have told theirs of a frame, or a newer frame begins."""
        if self.infos[side] is None:  # where it looks is not known yet
            return
        try:
            time, pixel = pixel_from_message(message)
            if time > self.frame and self.sides and len(self.sides) < len(WIDE_SIDES):  # the other camera saw nothing
                self.publish()
            self.tracker.add_pixel(time, side, pixel, self.noise)
        except TtError as error:
            self.bad_pixels(error)
            return
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


def main() -> None:
    """Run the node."""
    run(TrackNode, nice=NICE)


if __name__ == "__main__":
    main()
