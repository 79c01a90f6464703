"""Stands in for the hardware: catapult, ball, cameras and arm in one process, paced in real time.

A launch is rendered first, on a thread, and flown when its images are ready: a flight up to the racket is known beforehand. A second thread
keeps the deadlines of frames and ticks, because timers of rclpy drift.
"""

from __future__ import annotations

import json
import threading
import time
from collections import deque
from dataclasses import dataclass

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger
from tt_arm.model import ArmModel
from tt_arm.swing import Joints
from tt_core.errors import TtError, check_range
from tt_core.ros.convert import ball_to_message, camera_to_message, image_to_message, joints_to_message, racket_to_message, stamp
from tt_core.ros.params import declare, declare_physics, parameter
from tt_core.ros.qos import LATCHED, LATEST, RELIABLE, SENSOR, TRUTH
from tt_core.ros.run import run
from tt_core.ros.status import Status
from tt_core.states import Array, BallState
from tt_vision.rig import FRAME_RATE, high_speed_pair

from .footage import footage
from .launcher import LauncherParams, launch
from .outcome import Outcome
from .plant import Plant, PlantParams
from .render import Scene, Texture
from .world import RacketMotion, World

CAMERAS = ("left", "right")
STALE = 0.1  # s, after which a command no longer holds, as in the drives of real arms


@dataclass(frozen=True)
class SimParams:
    """The simulator itself."""

    rtf: float = 1.0  # simulated seconds in a second
    seed: int = 0
    tick: float = 0.002  # s, between two states of the arm
    clock_rate: float = 250.0  # 1/s, of /clock
    lead: float = 0.05  # s, from the images being ready to the launch
    always_on: bool = False  # frames without a ball are published too

    def __post_init__(self) -> None:
        check_range("rtf", self.rtf, 0.01, 10.0)
        check_range("tick", self.tick, 5e-4, 0.02)
        check_range("clock_rate", self.clock_rate, 1.0, 1000.0)
        check_range("lead", self.lead, 0.0, 5.0)


@dataclass
class Flight:
    """One launch, rendered: times are seconds after the launch."""

    number: int
    label: str
    ball: BallState
    frames: deque[tuple[float, list[Image]]]


class SimNode(Node):
    """/arm_velocity_controller/commands and /launcher/launch -> images, /joint_states, /clock, and the truth on /sim/*."""

    def __init__(self) -> None:
        super().__init__("sim")
        self.params = declare(self, SimParams)
        self.physics = declare_physics(self)
        self.launcher = declare(self, LauncherParams, "launcher.")
        self.order = [_shot(s) for s in parameter(self, "shots", ["top 3", "back 3", "left 3", "top 5", "back 4", "right 4"])]
        self.rng = np.random.default_rng(self.params.seed)
        self.scene = Scene(texture=Texture.drawn(self.params.seed))
        self.cameras = high_speed_pair()
        self.arm = ArmModel.pa10()
        self.plant = Plant(self.arm, declare(self, PlantParams, "plant."))
        self.world = World(self.physics)
        self.command: Array = np.zeros(len(self.arm.names))
        self.commanded = 0.0  # s, monotonic, when it came
        self.launched = 0
        self.rendering = threading.Event()  # set while a launch waits for its images or its ball flies
        self.ready: Flight | None = None
        self.outcome: Outcome | None = None

        self.status = Status(self)
        self.images = [self.create_publisher(Image, f"/camera/{name}/image_raw", SENSOR) for name in CAMERAS]
        self.infos = [self.create_publisher(CameraInfo, f"/camera/{name}/camera_info", LATCHED) for name in CAMERAS]
        for publisher, camera, name in zip(self.infos, self.cameras, CAMERAS, strict=True):
            size = camera.width, camera.height
            publisher.publish(camera_to_message(*size, camera.matrix, camera.distortion, f"{name}_optical"))
        self.joints = self.create_publisher(JointState, "/joint_states", RELIABLE)
        self.clock = self.create_publisher(Clock, "/clock", LATEST)
        self.true_ball = self.create_publisher(Odometry, "/sim/ball", TRUTH)
        self.true_racket = self.create_publisher(Odometry, "/sim/racket", TRUTH)
        self.create_subscription(Float64MultiArray, "/arm_velocity_controller/commands", self.on_command, LATEST)
        self.create_service(Trigger, "/launcher/launch", self.on_launch)
        for _ in footage(*launch("top", 5, self.launcher, np.random.default_rng(0)), self.cameras, self.scene, self.physics, self.rng):
            break  # loads the kernels
        threading.Thread(target=self.pace, daemon=True).start()

    def on_command(self, message: Float64MultiArray) -> None:
        command = np.array(message.data)
        if command.shape == self.command.shape and np.isfinite(command).all():
            self.command, self.commanded = command, time.monotonic()
        else:
            self.status.tell(f"command refused: {len(message.data)} numbers, {len(self.command)} finite ones wanted", warn=True)

    def on_launch(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self.rendering.is_set():
            response.message = "the last ball is not over yet"
            return response
        self.rendering.set()
        kind, scale = self.order[self.launched % len(self.order)]
        self.launched += 1
        response.success, response.message = True, f"{kind} {scale}"
        threading.Thread(target=self.render, args=(self.launched, kind, scale), daemon=True).start()
        return response

    def render(self, number: int, kind: str, scale: int) -> None:
        ball, orientation = launch(kind, scale, self.launcher, self.rng)
        frames = deque(
            (frame.time, [image_to_message(i, 0.0, f"{name}_optical") for i, name in zip(frame.images, CAMERAS, strict=True)])
            for frame in footage(ball, orientation, self.cameras, self.scene, self.physics, self.rng)
        )
        self.ready = Flight(number, f"{kind} {scale}", ball, frames)

    def pace(self) -> None:
        """Until the node is shut down."""
        try:
            self.keep_time()
        except RuntimeError:  # published into a context that a signal has just ended
            if self.context.ok():
                raise

    def keep_time(self) -> None:
        """Ticks at whole multiples, frames at their stamps, on a clock that runs `rtf` times the real one."""
        start, real_start = time.time(), time.monotonic()
        joints = Joints(start, self.arm.waiting, np.zeros(len(self.arm.names)))
        racket = self.plant.racket(joints)
        noise = np.random.default_rng(self.params.seed + 1)  # of the encoders; the other generator is the launches'
        now, launch_time = start, 0.0
        dark_due = start if self.params.always_on else np.inf
        flight: Flight | None = None
        dark = [
            image_to_message(np.full((c.height, c.width), 8, np.uint8), 0.0, f"{n}_optical")
            for c, n in zip(self.cameras, CAMERAS, strict=True)
        ]
        clock_due = start
        while self.context.ok():
            tick_due = now + self.params.tick
            frame_due = launch_time + flight.frames[0][0] if flight and flight.frames else dark_due
            due = min(tick_due, frame_due)
            wait = (due - start) / self.params.rtf - (time.monotonic() - real_start)
            if wait > 0.0:
                time.sleep(wait)
            if frame_due <= tick_due:
                images = flight.frames.popleft()[1] if flight and flight.frames else dark
                for publisher, image in zip(self.images, images, strict=True):
                    image.header.stamp = stamp(frame_due)
                    publisher.publish(image)
                if self.params.always_on:
                    dark_due = frame_due + 1.0 / FRAME_RATE
                continue
            now = tick_due
            if now >= clock_due:
                self.clock.publish(Clock(clock=stamp(now)))
                clock_due = now + 1.0 / self.params.clock_rate
            if time.monotonic() - self.commanded > STALE / self.params.rtf:
                self.command = np.zeros_like(self.command)
            joints = self.plant.advance(joints, self.command, self.params.tick)
            before, racket = racket, self.plant.racket(joints)
            measured = self.plant.measured(joints, noise)
            self.joints.publish(joints_to_message(self.arm.names, now, measured.q, measured.qdot))
            if flight is None and self.ready is not None:
                flight, self.ready = self.ready, None
                launch_time = now + self.params.lead
                self.outcome = Outcome(BallState.from_vector(launch_time, flight.ball.vector))
            if flight is not None and self.outcome is not None and now >= launch_time:
                self.fly(now, before, racket)
                if self.outcome.over(self.world.ball, now):
                    self.tell(flight, self.outcome)
                    self.world.ball, self.outcome, flight = None, None, None
                    self.rendering.clear()

    def fly(self, now: float, before: RacketMotion, racket: RacketMotion) -> None:
        """One tick of the ball; a contact is told as two states of one time."""
        assert self.outcome is not None
        if self.world.ball is None and not self.outcome.contacts:
            self.world.ball = self.outcome.launched
            self.true_ball.publish(ball_to_message(self.outcome.launched))
        for contact in self.world.advance(now, before, racket, self.params.tick):
            self.outcome.contacts.append(contact)
            self.true_ball.publish(ball_to_message(contact.before))
            self.true_ball.publish(ball_to_message(contact.after))
        if self.world.ball is not None:
            self.true_ball.publish(ball_to_message(self.world.ball))
        self.true_racket.publish(racket_to_message(now, racket.position, racket.rotation, racket.velocity))

    def tell(self, flight: Flight, outcome: Outcome) -> None:
        """The truth about a ball that is over, for whoever evaluates."""
        hit, landing, launched = outcome.hit, outcome.landing, outcome.launched
        self.status.tell(
            "ball over",
            number=flight.number,
            shot=flight.label,
            result=outcome.result,
            launched=_json(launched),
            hit=_json(hit.before) if hit else "null",
            after_hit=_json(hit.after) if hit else "null",
            offset=hit.offset if hit else "null",
            landing=_json(landing.before) if landing else "null",
        )


def _json(ball: BallState) -> str:
    """[time, position, velocity, spin] flat."""
    return json.dumps([ball.time, *ball.vector.tolist()])


def _shot(text: str) -> tuple[str, int]:
    """ "top 3" -> ("top", 3); raises TtError for other words, and launch() for kinds and scales it does not have."""
    kind, _, scale = text.partition(" ")
    if not scale.isdigit():
        raise TtError(f"shot {text!r} is not a kind and a scale, as in 'top 3'")
    launch(kind, int(scale), LauncherParams(), np.random.default_rng(0))
    return kind, int(scale)


def main() -> None:
    run(SimNode)


if __name__ == "__main__":
    main()
