"""Learn the coefficients of air, table and racket rubber from each ball that is played, and publish them on the topic `physics`."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from tt_arm.arm_file import InstalledArm
from tt_arm.joints import Joints
from tt_core.errors import TtError
from tt_core.factors import FACTORS
from tt_core.failures import Failure
from tt_core.learnt_physics import LISTENERS, physics_to_text
from tt_core.params import check, param
from tt_core.priority import Priority
from tt_core.ros.convert import ball_from_message, joints_from_message
from tt_core.ros.diagnostics import Event, Status
from tt_core.ros.inputs import JOINTS_FORM, STATE_FORM, Input
from tt_core.ros.node_main import run
from tt_core.ros.params import declare, declare_physics
from tt_core.ros.qos import LATCHED, RELIABLE, SENSOR
from tt_core.ros.refusals import Refusals
from tt_core.states import Array, BallState
from tt_eval.contact_watch import is_near, racket_of, time_to_contact
from tt_eval.lesson import RETURN_SEEN, Lesson
from tt_predict.learning import LearningParams, PhysicsLearner
from tt_vision.rig import CLOCK_SPREAD, WIDE_BIAS, wide_pair
from tt_vision.tracking import TrackerParams
from tt_vision.warm import warm_tracker
from tt_vision.wide_inputs import WideInputs

NICE = 5  # priority of the process: the nodes that play the ball come first
LAG = 0.15  # s, delay with which joint states and pixels are processed: pixels come up to 0.1 s late on a busy machine
MOST_QUEUED = 1000  # length of the queues: 3 s of pixels of both cameras, 2 s of joint states
SHOWN_CHANGE = 0.005  # least change of a factor that the terminal shows
PIXEL_SILENCE = 0.3  # s without a pixel, after which a ball is over


class LearnLine(Enum):
    """Messages that this node writes to the terminal."""

    LEARNT = "factors of the coefficients after this ball: {factors}"


class LearnFailure(Enum):
    """What goes wrong beside learning."""

    NOT_SAVED = "not saved: {error}"


@dataclass(frozen=True)
class LearnParams:
    """Parameters of the node: the file to which the learnt coefficients are saved."""

    save: str = param("", "", "file that is written after each ball, for `more_params_file:=` of the next start; empty: none")

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


class LearnNode(Node):
    """Node that learns the coefficients of flight, table and racket from the balls that are played.

    It follows each ball before and after its contact with the racket: by the pixels at which the wide cameras see the ball, by
    ball/measured, and by joint_states. After each ball from which something was learnt, it publishes the coefficients on `physics`. The arm
    and the poses of the wide cameras are given by the same parameters as in the nodes arm and track.
    """

    def __init__(self) -> None:
        """Declare the parameters, compile the kernels, then subscribe."""
        super().__init__("learn")
        self.params = declare(self, LearnParams)
        self.tracking = declare(self, TrackerParams(camera_bias=WIDE_BIAS, clock_spread=CLOCK_SPREAD))
        self.physics = declare_physics(self)
        self.base = str(self.get_parameter("physics").value)
        self.learner = PhysicsLearner(self.physics, declare(self, LearningParams, "learning."))
        arm = declare(self, InstalledArm)
        self.model = arm.model()
        self.joint_names = arm.joint_names(self.model)
        self.lesson: Lesson | None = None
        self.measured: BallState | None = None  # a measured ball that waits until the pixels before it have been used
        self.ball: BallState | None = None  # newest state of the followed ball before it meets the racket
        self.waiting = deque[tuple[float, int, Array]](maxlen=MOST_QUEUED)  # pixels to process: stamp (s), camera (0 or 1), pixel (2,)
        self.joints = deque[Joints](maxlen=MOST_QUEUED)  # joint states to process, those of the last LAG s
        self.newest = -np.inf  # s, stamp of the newest pixel
        warm_tracker(wide_pair())
        self.status = Status(self)
        self.learnt = self.create_publisher(String, "physics", LATCHED)
        self.refused = {what: Refusals(self.status, what) for what in ("measured ball", "joint state")}
        self.wide = WideInputs(self, self.status, self.on_pixel, self.on_calibration)
        inputs = list(self.wide.inputs)
        ball, joints = self.refused["measured ball"], self.refused["joint state"]
        inputs.append(Input(self, STATE_FORM, "ball/measured", self.on_ball, RELIABLE, refused=ball))
        inputs.append(Input(self, JOINTS_FORM, "joint_states", self.on_joints, SENSOR, refused=joints))
        self.status.wait_for(inputs)

    def on_calibration(self) -> None:
        """Drop the present ball, because it was followed with another calibration of the cameras."""
        self.lesson = None

    def on_ball(self, message: Odometry) -> None:
        """Keep a measured ball until the pixels before it have been processed."""
        try:
            self.measured = ball_from_message(message)
        except TtError as error:
            self.refused["measured ball"](error)

    def on_pixel(self, stamp: float, side: int, pixel: Array) -> None:
        """Put a pixel at which a wide camera sees the ball into the queue.

        Args:
            stamp: Time of the image, s.
            side: Camera, 0 (left) or 1 (right).
            pixel: (2,) pixels.
        """
        self.waiting.append((stamp, side, pixel))

    def on_joints(self, message: JointState) -> None:
        """Queue a joint state, and process those that are LAG s old, as all pixels of their time have arrived by now."""
        try:
            state = joints_from_message(message, self.joint_names)
            if state is None:
                return
            stamp, q, qdot = state
            if qdot is None:
                return
            self.joints.append(Joints(stamp, q, qdot))
            while self.joints and not 0.0 <= self.joints[-1].time - self.joints[0].time < LAG:
                self.process_joints(self.joints.popleft())
        except TtError as error:
            self.refused["joint state"](error)

    def process_joints(self, joints: Joints) -> None:
        """Process a joint state: check whether the racket has met the ball, use the pixels up to its time, check whether the ball is over.

        The contact is looked for first, because the tracker must not get pixels of the returned ball before the contact is known.
        """
        if self.lesson is not None and self.lesson.struck == np.inf:
            self.look_for_contact(self.lesson, joints)
        self.take_pixels(joints.time)
        lesson = self.lesson
        if lesson is not None and joints.time > min(self.newest + PIXEL_SILENCE, lesson.struck + RETURN_SEEN + PIXEL_SILENCE):
            self.finish()

    def take_pixels(self, until: float) -> None:
        """Give the pixels up to the time `until` (s) to the lesson, which follows one ball to learn from it."""
        news = False
        while self.waiting and self.waiting[0][0] <= until:
            stamp, side, pixel = self.waiting.popleft()
            if self.measured is not None and stamp >= self.measured.time:
                self.begin(self.measured)
            goes_on = abs(stamp - self.newest) < PIXEL_SILENCE
            if self.lesson is not None or not goes_on:  # further pixels of a ball that is over are not used
                news = self.lesson_at(stamp).add_pixel(stamp, side, pixel) or news
            self.newest = max(self.newest, stamp) if goes_on else stamp
        if news and self.lesson is not None:
            self.ball = self.lesson.tracker.state()

    def begin(self, ball: BallState) -> None:
        """Give a measured ball to the lesson; begin a new lesson if the ball of the present one was struck before."""
        self.measured = None
        if self.lesson is not None and self.lesson.struck < ball.time:  # it comes before the last one is over
            self.finish()
        self.lesson_at(ball.time).start(ball)

    def look_for_contact(self, lesson: Lesson, joints: Joints) -> None:
        """Tell the lesson that the racket has met the ball, if this is the first joint state after the contact.

        Args:
            lesson: The present lesson, whose ball was not struck yet.
            joints: The joint state.
        """
        if self.ball is None:
            return
        met = racket_of(self.model, joints)
        if not is_near(met.racket, self.ball):
            return
        ball = lesson.tracker.state(joints.time)
        if ball is not None and time_to_contact(met.racket, ball) <= 0.0:
            lesson.strike(met.racket, met.turning)

    def lesson_at(self, stamp: float) -> Lesson:
        """Return the lesson of the ball that is seen at `stamp` (s); after PIXEL_SILENCE s without pixels it is a new one."""
        if self.lesson is not None and abs(stamp - self.newest) > PIXEL_SILENCE:
            self.finish()
        if self.lesson is None:
            self.lesson, self.ball = Lesson(self.learner, self.wide.cameras, self.tracking), None
            self.newest = stamp
        return self.lesson

    def finish(self) -> None:
        """Finish the present lesson: learn from its ball, and publish and save the coefficients if they have changed."""
        lesson, self.lesson = self.lesson, None
        if lesson is None or not lesson.finish():
            return
        physics = self.learner.physics
        self.learnt.publish(String(data=physics_to_text(physics, self.base, LISTENERS)))
        if self.params.save:
            try:
                Path(self.params.save).write_text(physics_to_text(physics, self.base))
            except OSError as error:
                failure = Failure(LearnFailure.NOT_SAVED, error=error)
                self.status.publish(str(failure), warn=True, reason=failure)
        factors: dict[str, Any] = dict(zip(FACTORS, np.exp(self.learner.logarithms).round(4).tolist(), strict=True))
        self.status.publish(Event.LEARNT, stamp=self.newest, **factors)
        changed = [f"{name} {factor:.3f}" for name, factor in factors.items() if abs(factor - 1.0) > SHOWN_CHANGE]
        self.status.terminal.info(LearnLine.LEARNT, factors=", ".join(changed) or f"none by more than {SHOWN_CHANGE:.1%}")


def main() -> None:
    """Run the node."""
    run(LearnNode, Priority(nice=NICE))


if __name__ == "__main__":
    main()
