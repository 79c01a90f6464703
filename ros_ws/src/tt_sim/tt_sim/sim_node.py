"""Simulates the hardware: launcher, ball, cameras and arm in one process, in real time.

Another process renders the images of a launched ball first, and the ball flies when they are ready: its flight up to the racket is known
before. A thread keeps the times of frames and ticks (steps of the simulation), because timers of rclpy drift. Topics without subscribers
are not published.
"""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable
from enum import Enum
from typing import Any

import numpy as np
from geometry_msgs.msg import PointStamped
from nav_msgs.msg import Odometry
from rclpy.clock import Clock as NodeClock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger
from tt_arm.arm_file import load_arm
from tt_arm.joints import Joints
from tt_core.errors import TtError
from tt_core.failures import Failure, code_name
from tt_core.physics import Physics
from tt_core.priority import CONTROL
from tt_core.robots import read_arm
from tt_core.ros.clock_offset import answer_clock_pings
from tt_core.ros.convert import (
    ball_to_message,
    camera_to_message,
    image_to_message,
    joints_to_message,
    pixel_to_message,
    racket_to_message,
    stamp,
)
from tt_core.ros.diagnostics import Event, Status
from tt_core.ros.inputs import PUBLISHER_CHECK_INTERVAL, Input, MessageForm
from tt_core.ros.node_main import run
from tt_core.ros.params import declare, declare_physics
from tt_core.ros.qos import LATCHED, LATEST, NEWEST, RELIABLE, SENSOR, TRUTH
from tt_core.ros.refusals import Refusals
from tt_core.shared_memory import IMAGE_SEGMENT
from tt_core.states import Array, BallState
from tt_vision.rig import SIDES, WIDE_SIDES, high_speed_pair, wide_pair

from .cameras.render_worker import LaunchRenderer
from .launch_store import LaunchStore, ReadyLaunch
from .sim_loop import SimLoop
from .sim_params import SimParams
from .simulated_robot import Tick, warm
from .world.arm_record import ArmRecord
from .world.drive import Drive, DriveParams
from .world.launcher import LauncherParams
from .world.outcome import Outcome
from .world.plant import Plant, PlantParams
from .world_file import WorldParams, load_world

THREAD_SWITCH_INTERVAL = 5e-4  # s, longest time that the thread of SimLoop waits for another thread of Python
COMMAND_FORM = MessageForm(Float64MultiArray, 4096)
DARK = 8  # grey level of an image without a ball


class SimLine(Enum):
    """Lines that this node writes to the terminal."""

    LANDED = (
        "ball {number}, {shot}: {result}; hit {offset:.0f} mm off the centre, came down at {landing[0]:.2f}, {landing[1]:.2f} m "
        "after {seconds:.2f} s"
    )
    OVER = "ball {number}, {shot}: {result}"
    FOLLOWS = "the drives follow commands"


class SimFailure(Enum):
    """What is wrong with the arm or its commands: codes of `tt_core.failures.Failure`."""

    SECOND_PUBLISHER = "commands refused: {count} publishers, {names}"
    NO_COMMAND = "the drives brake: no command in time"
    BOUND_BROKEN = "bound broken"


class SimNode(Node):
    """ROS node that simulates launcher, ball, cameras and arm.

    It takes joint velocity commands and requests for launches. It publishes images, pixels of the wide cameras, joint states, the clock,
    and the true states of ball and racket. The thread of SimLoop calls the methods publish_*, report_* and wants_pixels.
    """

    def __init__(self) -> None:
        """Declare parameters, start the process that renders, compile the kernels, then subscribe and start the loop."""
        super().__init__("sim")
        self.params = declare(self, SimParams, changed=self.on_params)
        self.world = self.chosen_world().of_session(self.params.seed)
        self.launcher = declare(self, LauncherParams, "launcher.", changed=self.on_launcher)
        self.arm = load_arm(self.params.robot)
        plant = Plant(self.arm, self.world.plant)
        given, _ = read_arm(self.params.robot)
        drives = declare(self, DriveParams(command_timeout=given.command_timeout))
        self.drive = Drive(self.arm.limits.reduced(speed=self.world.plant.speed_share), drives)
        world = self.world
        renderer = LaunchRenderer(self.params.seed, self.launcher, world.physics, world.domain_randomization, world.cameras)
        self.launches = LaunchStore(
            renderer,
            self.params.all_shots,
            self.params.repeat,
            lambda image: image_to_message(image.image, 0.0, f"{SIDES[image.side]}_optical"),
        )
        self.busy = threading.Event()  # set while a launch on request waits for its images or its ball flies
        self.filled: dict[Publisher, Any] = {}  # messages that are filled again and again, by their publishers
        self.create_publishers()
        self.refused = Refusals(self.status, "command")
        cameras = zip(high_speed_pair(), SIDES, strict=True)
        dark = [image_to_message(np.full((c.height, c.width), DARK, np.uint8), 0.0, f"{name}_optical") for c, name in cameras]
        self.loop = SimLoop(self.params, world, plant, self.drive, self.launches, dark, self)
        self.loop.rate = self.launcher.rate
        self.commands = Input(self, COMMAND_FORM, "arm_velocity_controller/commands", self.on_command, NEWEST, refused=self.refused)
        self.create_timer(PUBLISHER_CHECK_INTERVAL, self.check_sole_publisher, clock=NodeClock(clock_type=ClockType.STEADY_TIME))
        self.create_service(Trigger, "launcher/launch", self.on_launch)
        self.create_service(SetBool, "sim/pause", self.on_pause)
        self.create_service(Trigger, "sim/step", self.on_step)
        answer_clock_pings(self)
        warm(plant)
        sys.setswitchinterval(THREAD_SWITCH_INTERVAL)
        threading.Thread(target=self.keep_pace, daemon=True).start()
        threading.Thread(
            target=self.launches.keep_full, args=(self.context.ok, lambda: bool(self.loop.rate), self.render), daemon=True
        ).start()

    def chosen_world(self) -> WorldParams:
        """Return the world, the true physics and faults of the hardware, that the parameters choose.

        It is that of the parameter `world`, or else that of the parameters of physics and arm (`plant.*`).

        Raises:
            TtError: `world` is set, and so are parameters of physics or arm.
            BadFile: The file of the world cannot be read, or a value in it is wrong.
        """
        own = WorldParams(declare_physics(self), plant=declare(self, PlantParams, "plant."))
        if not self.params.world:
            return own
        if (own.physics, own.plant) != (Physics.liu(), PlantParams()):
            raise TtError(f"world = {self.params.world!r} excludes other values of physics, air.*, table.*, racket.* and plant.*")
        return load_world(self.params.world)

    def create_publishers(self) -> None:
        """Create all publishers, and publish the calibrations of the cameras."""
        self.status = Status(self, hardware="simulator")
        self.images = [self.create_publisher(Image, f"camera/{name}/image_raw", SENSOR) for name in SIDES]
        names, cameras = SIDES + WIDE_SIDES, high_speed_pair() + wide_pair()
        self.infos = [self.create_publisher(CameraInfo, f"camera/{name}/camera_info", LATCHED) for name in names]
        for publisher, camera, name in zip(self.infos, cameras, names, strict=True):
            size = camera.width, camera.height
            publisher.publish(camera_to_message(*size, camera.matrix, camera.distortion, f"{name}_optical"))
        self.pixels = [self.create_publisher(PointStamped, f"camera/{name}/ball", SENSOR) for name in WIDE_SIDES]
        self.joints = self.create_publisher(JointState, "joint_states", RELIABLE)
        self.clock = self.create_publisher(Clock, "/clock", LATEST)
        self.true_ball = self.create_publisher(Odometry, "sim/ball", TRUTH)
        self.true_racket = self.create_publisher(Odometry, "sim/racket", TRUTH)

    def on_params(self, params: SimParams) -> None:
        """Launch other shots from now on; use another length of a step."""
        if params.all_shots != self.params.all_shots:
            self.launches.shots = params.all_shots
            self.discard_launches()
        self.params = params

    def on_launcher(self, launcher: LauncherParams) -> None:
        """Launch at another rate from now on."""
        self.loop.rate = launcher.rate
        if not launcher.rate:
            self.discard_launches()

    def discard_launches(self) -> None:
        """Drop what was rendered ahead at a rate, but not a launch on request."""
        if not self.busy.is_set():
            self.launches.discard()

    def on_command(self, message: Float64MultiArray) -> None:
        """Hand the joint velocities of a command to the drive."""
        try:
            self.drive.take(message.data, time.monotonic())
        except TtError as error:
            self.refused(error)

    def check_sole_publisher(self) -> None:
        """Make the drives ignore all commands while more than one node publishes commands."""
        names = [f"{i.node_namespace.rstrip('/')}/{i.node_name}" for i in self.get_publishers_info_by_topic(self.commands.topic)]
        sole = len(names) <= 1
        if sole != self.drive.sole:
            self.drive.sole = sole
            failure = None if sole else Failure(SimFailure.SECOND_PUBLISHER, count=len(names), names=", ".join(sorted(names)))
            self.publish_state("commands obeyed: one publisher", failure)
            if failure is not None:
                self.status.terminal.warn(failure.code, **failure.values)

    def publish_state(self, state: str, failure: Failure | None, part: str = "", **values: Any) -> None:
        """Publish a state of the arm or its commands, or what is wrong with it."""
        code = code_name(failure)
        self.status.publish(str(failure or state), part=part, warn=failure is not None, reason=failure, code=code, **values)

    def on_launch(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Launch the next ball on request (service launcher/launch); refuse it if balls are launched at a rate or one is in flight."""
        if self.loop.rate or self.busy.is_set():
            response.message = (
                "refused: balls are launched at a rate" if self.loop.rate else "refused: the previous ball is still in flight"
            )
            return response
        self.busy.set()
        response.success, response.message = True, "{} {}".format(*self.launches.next_shot)
        threading.Thread(target=self.render, daemon=True).start()
        return response

    def on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """Stop or continue the simulated time (service sim/pause); refuse it if the nodes follow the system clock."""
        if request.data and not self.get_parameter("use_sim_time").value:
            response.message = "refused: the nodes follow the system clock, which does not pause; start with use_sim_time:=true"
            return response
        self.loop.pause(request.data)
        response.success, response.message = True, "paused" if request.data else "running"
        return response

    def on_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Let simulated time continue by the parameter `step` (service sim/step); refuse it if simulated time is not stopped."""
        if not self.loop.paused:
            response.message = "refused: simulated time does not stand still"
            return response
        response.success, response.message = True, f"to {self.loop.step(self.params.step):.6f} s"
        return response

    def render(self) -> None:
        """Render the images of the next launch; end the node if the process that renders has ended."""
        try:
            self.launches.render()
        except EOFError:
            signal.raise_signal(signal.SIGTERM)
            raise

    def keep_pace(self) -> None:
        """Run SimLoop until the node is shut down; end the node if the loop fails."""
        try:
            self.loop.run(self.context.ok)
        except BaseException:
            if self.context.ok():  # otherwise it was published into a context that a signal has just ended
                signal.raise_signal(signal.SIGTERM)
                raise

    def close(self) -> None:
        """End the process that renders."""
        self.launches.close()

    def publish_image(self, side: int, stamped: float, message: Image) -> None:
        """Publish an image.

        Args:
            side: Camera: 0 left, 1 right.
            stamped: s, middle of the exposure by the clock of the cameras.
            message: The image; its stamp is set here.
        """
        message.header.stamp = stamp(stamped)
        self.images[side].publish(message)

    def publish_clock(self, now: float) -> None:
        """Publish the simulated time `now` (s) on /clock if a node subscribes to it."""
        if has_subscribers(self.clock):
            self.clock.publish(Clock(clock=stamp(now)))

    def publish_ball(self, ball: BallState) -> None:
        """Publish the true state of a ball on sim/ball."""
        self.publish(self.true_ball, ball_to_message, ball)

    def publish_joints(self, joints: Joints, effort: Array) -> None:
        """Publish the joint states.

        Args:
            joints: Measured positions and speeds.
            effort: (n,) N m, torques of the motors.
        """
        self.publish(self.joints, joints_to_message, self.arm.names, joints.time, joints.q, joints.qdot, effort)

    def publish_truth(self, tick: Tick) -> None:
        """Publish the true states of the racket and of the ball in flight at the end of a tick, one step of the simulation.

        For each contact of the ball during the tick the states before and after it are published, with the same stamp. Racket and ball at
        the end of the tick are not published if no ball is in flight.
        """
        balls = [ball for contact in tick.contacts for ball in (contact.before, contact.after)]
        if tick.ball is not None:
            balls.append(tick.ball)
            if has_subscribers(self.true_racket):
                racket = tick.racket
                quaternion = Rotation.from_matrix(racket.rotation).as_quat()
                self.publish(self.true_racket, racket_to_message, tick.joints.time, racket.position, quaternion, racket.velocity)
        if has_subscribers(self.true_ball):
            for ball in balls:
                self.publish_ball(ball)

    def wants_pixels(self) -> bool:
        """Tell whether any node subscribes to the pixels of the wide cameras."""
        return any(map(has_subscribers, self.pixels))

    def publish_pixel(self, side: int, stamped: float, pixel: Array) -> None:
        """Publish the pixel of the ball that a wide camera has found.

        Args:
            side: Camera: 0 left, 1 right.
            stamped: s, middle of the exposure.
            pixel: (2,) column and row of the ball's centre.
        """
        self.pixels[side].publish(pixel_to_message(stamped, pixel, f"{WIDE_SIDES[side]}_optical"))

    def report_drive(self, is_braking: bool) -> None:
        """Report that the drives brake, or that they obey again."""
        self.publish_state("follows commands", Failure(SimFailure.NO_COMMAND) if is_braking else None, "drive")
        self.status.terminal.info(SimFailure.NO_COMMAND if is_braking else SimLine.FOLLOWS)

    def report_record(self, record: ArmRecord) -> None:
        """Report the worst that the true arm did."""
        self.publish_state("bounds kept", None if record.kept else Failure(SimFailure.BOUND_BROKEN), "arm record", **record.to_text())

    def report_end(self, launch: ReadyLaunch, outcome: Outcome) -> None:
        """Report the result of a ball. `busy` is cleared first, because a node that receives the report may request a launch at once."""
        self.busy.clear()
        self.status.publish(Event.BALL_OVER, number=launch.number, shot=launch.shot, **outcome.to_text())
        values = {"number": launch.number, "shot": launch.shot, "result": outcome.result.value}
        hit, landing = outcome.hit, outcome.landing
        if hit is None or landing is None:
            self.status.terminal.info(SimLine.OVER, **values)
            return
        values |= {"landing": landing.before.position, "seconds": landing.before.time - hit.before.time}
        self.status.terminal.info(SimLine.LANDED, offset=1e3 * hit.offset, **values)

    def publish(self, publisher: Publisher, convert: Callable[..., Any], *values: Any) -> None:
        """Publish a converted state, and use the same message again for each publisher.

        Args:
            publisher: The publisher.
            convert: Function of tt_core.ros.convert that fills a message; its last argument is the message to fill, or None.
            values: Its other arguments.
        """
        message = self.filled[publisher] = convert(*values, self.filled.get(publisher))
        publisher.publish(message)


def has_subscribers(publisher: Publisher) -> bool:
    """Tell whether any node subscribes to the publisher's topic."""
    return publisher.get_subscription_count() > 0


def main() -> None:
    """Run the node."""
    run(SimNode, CONTROL, IMAGE_SEGMENT)


if __name__ == "__main__":
    main()
