"""Publish what the robot learns of air, table and rubber from each ball, on `physics`."""

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
from tt_core.learnt_physics import physics_to_text
from tt_core.params import check, param
from tt_core.priority import Priority
from tt_core.ros.convert import ball_from_message, joints_from_message
from tt_core.ros.diagnostics import Event, Status
from tt_core.ros.inputs import Input
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

NICE = 5  # priority of the process: the ball on its way comes first
LARGEST_STATE, LARGEST_JOINTS = 4096, 1 << 16  # bytes
LAG = 0.15  # s, by which joint states and pixels are looked at later: on a busy machine pixels come 0.1 s late, and learning has time
MOST_WAITING = 1000  # pixels, 3 s of both cameras, and joint states, 2 s
SILENCE = 0.3  # s without a pixel, after which a ball is over


class LearnFailure(Enum):
    """What goes wrong beside learning."""

    NOT_SAVED = "not saved: {error}"


@dataclass(frozen=True)
class LearnParams:
    """The file of learnt coefficients."""

    save: str = param("", "", "file that is written after each ball, for `more_params_file:=` of the next start; empty: none")

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


class LearnNode(Node):
    """Subscribe to pixels, camera_info, ball/measured and joint_states; publish `physics` after each ball that has told something.

    The arm and the poses of the wide cameras are parameters, as of the nodes arm and track.
    """

    def __init__(self) -> None:
        """Declare parameters, compile the kernels, then subscribe."""
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
        self.measured: BallState | None = None  # one that has arrived, until the pixels before it have been used
        self.ball: BallState | None = None  # the newest state of the ball before the racket
        self.waiting = deque[tuple[float, int, Array]](maxlen=MOST_WAITING)  # pixels that no joint state has passed yet
        self.joints = deque[Joints](maxlen=MOST_WAITING)  # joint states, LAG of them
        self.newest = -np.inf  # s, stamp of the newest pixel
        warm_tracker(wide_pair())
        self.status = Status(self)
        self.learnt = self.create_publisher(String, "physics", LATCHED)
        self.refused = {what: Refusals(self.status, what) for what in ("measured ball", "joint state")}
        self.wide = WideInputs(self, self.status, self.on_pixel, self.on_calibration)
        inputs = list(self.wide.inputs)
        ball, joints = self.refused["measured ball"], self.refused["joint state"]
        inputs.append(Input(self, Odometry, "ball/measured", self.on_ball, RELIABLE, largest=LARGEST_STATE, refused=ball))
        inputs.append(Input(self, JointState, "joint_states", self.on_joints, SENSOR, largest=LARGEST_JOINTS, refused=joints))
        self.status.wait_for(inputs)

    def on_calibration(self) -> None:
        """Give up the ball that was seen with the cameras as they were known before."""
        self.lesson = None

    def on_ball(self, message: Odometry) -> None:
        """Take a measured ball; it counts once the pixels before it have been looked at."""
        try:
            self.measured = ball_from_message(message)
        except TtError as error:
            self.refused["measured ball"](error)

    def on_pixel(self, stamp: float, side: int, pixel: Array) -> None:
        """Take a pixel of the ball before or after the racket."""
        self.waiting.append((stamp, side, pixel))

    def on_joints(self, message: JointState) -> None:
        """Take a joint state, and look at those that are LAG old: the pixels of their time have come by now."""
        try:
            state = joints_from_message(message, self.joint_names)
            if state is None or state[2] is None:
                return
            self.joints.append(Joints(state[0], state[1], state[2]))
            while self.joints and not 0.0 <= self.joints[-1].time - self.joints[0].time < LAG:
                self.look(self.joints.popleft())
        except TtError as error:
            self.refused["joint state"](error)

    def look(self, joints: Joints) -> None:
        """See whether the racket meets the ball, then take the pixels up to here, and see whether the ball is over.

        The tracker must not see the return before the contact is known.
        """
        if self.lesson is not None and self.lesson.struck == np.inf:
            self.look_for_contact(self.lesson, joints)
        self.take_pixels(joints.time)
        lesson = self.lesson
        if lesson is not None and joints.time > min(self.newest + SILENCE, lesson.struck + RETURN_SEEN + SILENCE):
            self.finish()

    def take_pixels(self, until: float) -> None:
        """Give the lesson the pixels up to a time (s)."""
        news = False
        while self.waiting and self.waiting[0][0] <= until:
            stamp, side, pixel = self.waiting.popleft()
            if self.measured is not None and stamp >= self.measured.time:
                self.begin(self.measured)
            goes_on = abs(stamp - self.newest) < SILENCE
            if self.lesson is not None or not goes_on:  # of a ball that is over nothing more is learnt
                news = self.lesson_at(stamp).add_pixel(stamp, side, pixel) or news
            self.newest = max(self.newest, stamp) if goes_on else stamp
        if news and self.lesson is not None:
            self.ball = self.lesson.tracker.state()

    def begin(self, ball: BallState) -> None:
        """Begin, or go on, with a measured ball."""
        self.measured = None
        if self.lesson is not None and self.lesson.struck < ball.time:  # it comes before the last one is over
            self.finish()
        self.lesson_at(ball.time).start(ball)

    def look_for_contact(self, lesson: Lesson, joints: Joints) -> None:
        """Tell the lesson of the contact at the first joint state after it."""
        if self.ball is None:
            return
        met = racket_of(self.model, joints)
        if not is_near(met.racket, self.ball):
            return
        ball = lesson.tracker.state(joints.time)
        if ball is not None and time_to_contact(met.racket, ball) <= 0.0:
            lesson.strike(met.racket, met.turning)

    def lesson_at(self, stamp: float) -> Lesson:
        """Return the lesson of the ball that is seen at a stamp (s); begin another one after a struck ball or a pause."""
        if self.lesson is not None and abs(stamp - self.newest) > SILENCE:
            self.finish()
        if self.lesson is None:
            self.lesson, self.ball = Lesson(self.learner, self.wide.cameras, self.tracking), None
            self.newest = stamp
        return self.lesson

    def finish(self) -> None:
        """Learn from the ball that is over, and publish what has changed."""
        lesson, self.lesson = self.lesson, None
        if lesson is None or not lesson.finish():
            return
        text = physics_to_text(self.learner.physics, self.base)
        self.learnt.publish(String(data=text))
        if self.params.save:
            try:
                Path(self.params.save).write_text(text)
            except OSError as error:
                failure = Failure(LearnFailure.NOT_SAVED, error=error)
                self.status.publish(str(failure), warn=True, reason=failure)
        factors: dict[str, Any] = dict(zip(FACTORS, np.exp(self.learner.logarithms).round(4).tolist(), strict=True))
        self.status.publish(Event.LEARNT, stamp=self.newest, **factors)


def main() -> None:
    """Run the node."""
    run(LearnNode, Priority(nice=NICE))


if __name__ == "__main__":
    main()
