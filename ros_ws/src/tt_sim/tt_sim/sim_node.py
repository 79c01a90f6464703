"""Stands in for the hardware: catapult, ball, cameras and arm in one process, paced in real time.

A launch is rendered first, by another process, and flown when its images are ready: a flight up to the racket is known beforehand. A thread
keeps the deadlines of frames and ticks, because timers of rclpy drift. What no one listens to is not made.
"""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from geometry_msgs.msg import PointStamped
from nav_msgs.msg import Odometry
from rclpy.clock import Clock as NodeClock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger
from tt_arm.joints import Joints
from tt_arm.model import ArmModel
from tt_core.errors import TtError
from tt_core.params import check, param
from tt_core.physics import Physics
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
from tt_core.ros.diagnostics import Status
from tt_core.ros.inputs import LOOK, Input
from tt_core.ros.node_main import run
from tt_core.ros.params import declare, declare_physics
from tt_core.ros.qos import LATCHED, LATEST, NEWEST, RELIABLE, SENSOR, TRUTH
from tt_core.states import BallState
from tt_vision.rig import FRAME_RATE, high_speed_pair

from .cameras.render_worker import LaunchRenderer, RenderedLaunch, RenderWorker
from .cameras.tracking_cameras import TrackingCameras
from .simulated_robot import SimulatedRobot, Tick, warm
from .world.arm_record import ArmRecord
from .world.drive import Drive, DriveParams
from .world.launcher import LauncherParams, shot
from .world.plant import Plant, PlantParams
from .world_file import WorldParams, load_world

CAMERAS, WIDE = ("left", "right"), ("wide_left", "wide_right")
STORE = 2  # launches rendered ahead, at a rate
QUIET = 0.15  # s after a burst in which nothing is rendered: then others measure and plan
NICE = -10  # priority: hardware does not wait for a busy machine
SLEW = 2e-6  # s, by which the stamps are brought nearer to the system's clock in a tick; in a second that is 1 ms
SWITCH = 5e-4  # s, that the thread of the deadlines waits at most for another one's Python
LARGEST = 4096  # bytes of a command
PAUSE = 0.25  # s, at least, between two refusals told, and between two words about the drives
RECORD = 1.0  # s between two words about the arm's record
MOST_FLYING = 8  # balls at a time; at 94 a minute there are three
MOST_LATE = 1000  # pixels of the wide cameras on their way, 3 s of both


@dataclass(frozen=True)
class SimParams:
    """The simulator itself."""

    rtf: float = param(1.0, "", "simulated seconds in a second", low=0.01, high=10.0)
    seed: int = param(0, "", "seed of all that is random", low=0, high=2**31)
    world: str = param("", "", "name or path of a world file; empty: `physics` and `plant`")
    shots: tuple[str, ...] = param(
        ("top 3", "back 3", "left 3", "top 5", "back 4", "right 4"), "", "kind and scale of each launch, by turns", dynamic=True
    )
    tick: float = param(0.002, "s", "between two states of the arm", low=0.0005, high=0.02)
    clock_rate: float = param(250.0, "1/s", "of /clock", low=1.0, high=1000.0)
    lead: float = param(0.05, "s", "from the images being ready to the launch", low=0.0, high=5.0)
    always_on: bool = param(False, "", "frames without a ball are published too")
    repeat: int = param(0, "", "launches, after which the same ones begin again; 0: never", low=0, high=1000000.0)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)
        if not self.shots:
            raise TtError("shots = () is empty")
        self.all_shots  # noqa: B018  # raises for a shot that there is not

    @property
    def all_shots(self) -> list[tuple[str, int]]:
        """Kind and scale of each shot."""
        return [shot(text) for text in self.shots]


@dataclass
class Flight:
    """One launch, rendered. images: when each leaves and its stamp, both s after the launch, which camera took it, and the message."""

    number: int
    shot: str
    take: RenderedLaunch
    images: deque[tuple[float, float, int, Image]]


class SimNode(Node):
    """arm_velocity_controller/commands and /launcher/launch -> images, the wide cameras' pixels of the ball, /joint_states, /clock, and
    the truth on /sim/*."""

    def __init__(self) -> None:
        super().__init__("sim")
        self.params = declare(self, SimParams, changed=self.on_params)
        own = WorldParams(declare_physics(self), plant=declare(self, PlantParams, "plant."))
        self.world = load_world(self.params.world) if self.params.world else own
        if self.params.world and (own.physics, own.plant) != (Physics.liu(), PlantParams()):
            raise TtError(f"world = {self.params.world!r} excludes other values of physics, air.*, table.*, racket.* and plant.*")
        self.launcher = declare(self, LauncherParams, "launcher.", changed=self.on_launcher)
        self.shots = self.params.all_shots
        world = self.world
        self.studio = LaunchRenderer(self.params.seed, self.launcher, world.physics, world.domain_randomization, world.cameras)
        self.crew = RenderWorker(self.studio)
        self.cameras, self.arm = high_speed_pair(), ArmModel.pa10()
        self.plant = Plant(self.arm, self.world.plant)
        self.drive = Drive(self.arm.names, self.plant.limits.speed, declare(self, DriveParams))
        self.refused, self.refusal_told = 0, -np.inf  # commands since the start; s, monotonic
        self.launched, self.busy = 0, threading.Event()  # set while a launch on request waits for its images or its ball flies
        self.ready = deque[Flight]()  # STORE at most, or the one on request
        self.shown = -np.inf  # s, monotonic, when the last image of a ball left

        self.status = Status(self)
        self.images = [self.create_publisher(Image, f"camera/{name}/image_raw", SENSOR) for name in CAMERAS]
        self.infos = [self.create_publisher(CameraInfo, f"camera/{name}/camera_info", LATCHED) for name in CAMERAS]
        for publisher, camera, name in zip(self.infos, self.cameras, CAMERAS, strict=True):
            size = camera.width, camera.height
            publisher.publish(camera_to_message(*size, camera.matrix, camera.distortion, f"{name}_optical"))
        self.pixels = [self.create_publisher(PointStamped, f"camera/{name}/ball", SENSOR) for name in WIDE]
        self.joints = self.create_publisher(JointState, "joint_states", RELIABLE)
        self.clock = self.create_publisher(Clock, "/clock", LATEST)
        self.true_ball = self.create_publisher(Odometry, "sim/ball", TRUTH)
        self.true_racket = self.create_publisher(Odometry, "sim/racket", TRUTH)
        self.commands = Input(
            self,
            Float64MultiArray,
            "arm_velocity_controller/commands",
            self.on_command,
            NEWEST,
            largest=LARGEST,
            refused=self.on_refused,
        )
        self.create_timer(LOOK, self.look, clock=NodeClock(clock_type=ClockType.STEADY_TIME))
        self.create_service(Trigger, "launcher/launch", self.on_launch)
        answer_clock_pings(self)
        warm(self.plant)
        self.filled: dict[Publisher, Any] = {}  # messages that are filled again and again, by their publishers
        sys.setswitchinterval(SWITCH)
        threading.Thread(target=self.pace, daemon=True).start()
        threading.Thread(target=self.feed, daemon=True).start()

    def on_params(self, params: SimParams) -> None:
        """Launch other shots from now on; what is rendered already comes first."""
        self.params, self.shots = params, params.all_shots

    def on_launcher(self, launcher: LauncherParams) -> None:
        """Launch at another rate from now on."""
        self.launcher = launcher

    def on_command(self, message: Float64MultiArray) -> None:
        try:
            self.drive.take(message.data, time.monotonic())
        except TtError as error:
            self.on_refused(error)

    def on_refused(self, error: TtError) -> None:
        self.refused += 1
        if time.monotonic() - self.refusal_told >= PAUSE:
            self.refusal_told = time.monotonic()
            self.status.tell(f"command refused: {error}", warn=True, refused=self.refused)

    def look(self) -> None:
        """Obey no one while more than one publishes commands."""
        names = [f"{i.node_namespace.rstrip('/')}/{i.node_name}" for i in self.get_publishers_info_by_topic(self.commands.topic)]
        sole = len(names) <= 1
        if sole != self.drive.sole:
            self.drive.sole = sole
            text = "commands obeyed: one publisher" if sole else f"commands refused: {len(names)} publishers, {', '.join(sorted(names))}"
            self.status.tell(text, warn=not sole)

    def on_launch(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self.launcher.rate or self.busy.is_set():
            response.message = "the machine launches by itself" if self.launcher.rate else "the last ball is not over yet"
            return response
        self.busy.set()
        response.success, response.message = True, "{} {}".format(*self.coming)
        threading.Thread(target=self.render, daemon=True).start()
        return response

    @property
    def coming(self) -> tuple[str, int]:
        """The next shot."""
        number = self.launched % self.params.repeat if self.params.repeat else self.launched
        return self.shots[number % len(self.shots)]

    def feed(self) -> None:
        """At a rate: keeps rendered launches in store."""
        while self.context.ok():
            if self.launcher.rate and len(self.ready) < STORE and time.monotonic() > self.shown + QUIET:
                self.render()
            else:
                time.sleep(0.02)

    def render(self) -> None:
        """The next launch."""
        repeat = self.params.repeat
        if repeat and self.launched and self.launched % repeat == 0:
            self.crew.close()
            self.crew = RenderWorker(self.studio)
        kind, scale = self.coming
        self.launched += 1
        try:
            take = self.crew.take(kind, scale)
        except EOFError:
            signal.raise_signal(signal.SIGTERM)  # without cameras there is nothing to do
            raise
        if take is None:
            return
        images = deque((s.due, s.stamp, s.side, image_to_message(s.image, 0.0, f"{CAMERAS[s.side]}_optical")) for s in take.shown)
        self.ready.append(Flight(self.launched, f"{kind} {scale}", take, images))

    def close(self) -> None:
        self.crew.close()

    def pace(self) -> None:
        """Until the node is shut down."""
        try:
            self.keep_time()
        except BaseException:
            if self.context.ok():  # otherwise it was published into a context that a signal has just ended
                signal.raise_signal(signal.SIGTERM)  # without ticks there is nothing to do
                raise

    def keep_time(self) -> None:
        """Ticks at whole multiples, frames at their stamps, on a clock that runs `rtf` times the real one."""
        start, real_start, params = time.time(), time.monotonic(), self.params
        hardware = SimulatedRobot(
            self.world.physics, self.plant, Joints(start, self.arm.waiting, np.zeros(len(self.arm.names))), params.tick
        )
        noise = np.random.default_rng(params.seed + 1)  # of the encoders; the other generator is the launches'
        wide = TrackingCameras(
            self.world.tracking_cameras, self.world.physics.air.coefficients, start, np.random.default_rng(params.seed + 2)
        )
        record, record_told = ArmRecord(self.arm, hardware.joints), -np.inf
        late = deque[tuple[float, int, PointStamped]](maxlen=MOST_LATE)  # when they are due, s, which camera's, pixels on their way
        dark = [
            image_to_message(np.full((c.height, c.width), 8, np.uint8), 0.0, f"{n}_optical")
            for c, n in zip(self.cameras, CAMERAS, strict=True)
        ]
        flight, launch_time = None, -np.inf
        flying = dict[float, Flight]()  # by the time of launch
        braking, drive_told = True, -np.inf
        clock_due, dark_due = start, start if params.always_on else np.inf
        while self.context.ok():
            if params.rtf == 1.0:  # stamps follow the system's clock, which its time service makes faster or slower
                drift = time.time() - start - (time.monotonic() - real_start)
                real_start -= min(max(drift, -SLEW), SLEW)
            tick_due = hardware.joints.time + params.tick
            frame_due = launch_time + flight.images[0][0] if flight and flight.images else dark_due
            time.sleep(max(0.0, (min(tick_due, frame_due) - start) / params.rtf - (time.monotonic() - real_start)))
            if frame_due <= tick_due:
                if flight and flight.images:
                    _, stamped, side, image = flight.images.popleft()
                    self.shown = time.monotonic()
                    self.publish_image(side, launch_time + stamped, image)
                else:
                    for side, image in enumerate(dark):
                        self.publish_image(side, frame_due, image)
                dark_due = frame_due + 1.0 / FRAME_RATE if params.always_on else np.inf
                continue
            if tick_due >= clock_due:
                if heard(self.clock):
                    self.clock.publish(Clock(clock=stamp(tick_due)))
                clock_due = tick_due + 1.0 / params.clock_rate
            period = 60.0 / self.launcher.rate if self.launcher.rate else 0.0
            free = len(flying) < (MOST_FLYING if period else 1)
            if self.ready and tick_due + params.lead >= launch_time + period and free:
                flight = self.ready.popleft()
                launch_time = tick_due + params.lead
                flying[launch_time] = flight
                ball = BallState.from_vector(launch_time, flight.take.ball.vector)
                hardware.launch(ball, flight.take.physics)
                self.publish(self.true_ball, ball_to_message, ball)
            now, timeout = time.monotonic(), self.drive.params.command_timeout / params.rtf
            behind = now - real_start - (tick_due - start) / params.rtf > timeout  # this process was held up: what it missed was no command
            command = self.drive.command(now, params.tick, hardware.joints.qdot, -1.0 if behind else timeout)
            if self.drive.braking != braking and now - drive_told >= PAUSE:
                braking, drive_told = self.drive.braking, now
                self.status.tell("brakes" if braking else "follows commands", part="drive", warn=braking)
            tick = hardware.advance(command)
            if not behind:
                measured = self.plant.measured(tick.joints, noise)
                self.publish(self.joints, joints_to_message, self.arm.names, measured.time, measured.q, measured.qdot)
            if record.note(tick.joints) or now - record_told > RECORD:
                record_told = now
                text = "bounds kept" if record.kept else "bound broken"
                self.status.tell(text, part="arm record", warn=not record.kept, **record.told())
            self.publish_truth(tick)
            for seen, side, pixel in wide.frames(tick, any(map(heard, self.pixels))):
                late.append((seen + self.world.tracking_cameras.latency, side, pixel_to_message(seen, pixel, f"{WIDE[side]}_optical")))
            while late and late[0][0] <= tick.joints.time:
                _, side, message = late.popleft()
                self.pixels[side].publish(message)
            for outcome in tick.ended:
                over = flying.pop(outcome.launched.time)
                self.busy.clear()  # first: who hears of the end may launch at once
                self.status.tell("ball over", number=over.number, shot=over.shot, **outcome.told())

    def publish_image(self, side: int, stamped: float, image: Image) -> None:
        image.header.stamp = stamp(stamped)
        self.images[side].publish(image)

    def publish_truth(self, tick: Tick) -> None:
        """While a ball flies; a contact is told as two states of one time."""
        balls = [ball for contact in tick.contacts for ball in (contact.before, contact.after)]
        if tick.ball is not None:
            balls.append(tick.ball)
            if heard(self.true_racket):
                racket = tick.racket
                self.publish(self.true_racket, racket_to_message, tick.joints.time, racket.position, racket.rotation, racket.velocity)
        if heard(self.true_ball):
            for ball in balls:
                self.publish(self.true_ball, ball_to_message, ball)

    def publish(self, publisher: Publisher, convert: Callable[..., Any], *values: Any) -> None:
        """What `convert` makes of the values, in the message that was published there last."""
        message = self.filled[publisher] = convert(*values, self.filled.get(publisher))
        publisher.publish(message)


def heard(publisher: Publisher) -> bool:
    return publisher.get_subscription_count() > 0


def main() -> None:
    run(SimNode, nice=NICE)


if __name__ == "__main__":
    main()
