"""Subscriptions that keep a scene up to date, for the nodes that show one."""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import MultiDOFJointTrajectory
from tt_arm.model import ArmModel
from tt_core.errors import TtError
from tt_core.physics import Physics
from tt_core.ros.convert import (
    StampedStrokes,
    ball_from_message,
    goal_from_message,
    joints_from_message,
)
from tt_core.ros.diagnostics import Event, Status, read_status
from tt_core.ros.inputs import GOAL_FORM, JOINTS_FORM, PATH_FORM, STATE_FORM, STROKES_FORM, Input, MessageForm
from tt_core.ros.qos import LATCHED, LATEST, NEWEST, RELIABLE
from tt_core.ros.refusals import Refusals
from tt_core.states import Array, BallPath

from .robot_shapes import RobotShapes
from .scene import DrawnScene, ShownJoints, warm

DESCRIPTION_FORM, DIAGNOSTICS_FORM = MessageForm(String, 2**22), MessageForm(DiagnosticArray, 2**18)


class SceneInputs:
    """Subscribes to the robot's topics and keeps a scene up to date with them.

    Attributes:
        scene: The scene: what is known of table, arm and ball.
        refused: Called with the error of each message that cannot be used.
    """

    def __init__(
        self,
        node: Node,
        physics: Physics,
        status: Status,
        interval: float,
        also: Callable[[DiagnosticArray], None] = lambda _: None,
    ) -> None:
        """Subscribe to the topics. Until a robot_description arrives, the arm is the PA10.

        Args:
            node: The node that shows the scene.
            physics: Models of flight and rebounds with which the paths are predicted.
            status: Diagnostics of the node, on which refused messages are reported.
            interval: Shortest time between two joint states that are read, s.
            also: Called with each message on /diagnostics, too.
        """
        self._node, self._urdf, self._also = node, ArmModel.pa10().placed_description, also
        self.scene = DrawnScene(RobotShapes(self._urdf), physics)
        self.refused = Refusals(status, "message")
        warm(physics)
        refused = self.refused
        Input(node, DESCRIPTION_FORM, "robot_description", self.on_description, LATCHED, refused=refused)
        Input(node, JOINTS_FORM, "joint_states", self.on_joints, NEWEST, refused=refused, interval=interval)
        for topic in ("ball/first", "ball/measured", "ball/state"):  # paths begin at any of them
            Input(node, STATE_FORM, topic, self.on_estimate, RELIABLE, refused=refused)
        Input(node, PATH_FORM, "ball/path", self.on_path, RELIABLE, refused=refused)
        Input(node, STROKES_FORM, "racket/strokes", self.on_strokes, LATEST, refused=refused)
        Input(node, GOAL_FORM, "return/goal", self.on_goal, LATCHED, refused=refused)
        Input(node, DIAGNOSTICS_FORM, "/diagnostics", self.on_diagnostics, RELIABLE, refused=refused)

    def now(self) -> float:
        """Return the present time of the node's clock, s."""
        return float(self._node.get_clock().now().nanoseconds * 1e-9)

    def on_description(self, message: String) -> None:
        """Show the arm of a URDF (topic robot_description), unless it is shown already."""
        if message.data == self._urdf:
            return
        try:
            self.scene.take_robot(RobotShapes(message.data))
            self._urdf = message.data
        except TtError as error:
            self.refused(error)

    def on_joints(self, message: JointState) -> None:
        """Show the arm at the joint positions of a joint state."""
        names = [name for name in self.scene.robot.speed_limits if name in message.name]
        try:
            state = joints_from_message(message, names) if names else None
            if state is None:
                return
            stamp, q, qdot = state
            speeds = {} if qdot is None else dict(zip(names, qdot.tolist(), strict=True))
            self.scene.take_joints(stamp, ShownJoints(dict(zip(names, q.tolist(), strict=True)), speeds), self.now())
        except TtError as error:
            self.refused(error)

    def on_estimate(self, message: Odometry) -> None:
        """Keep a measured (ball/measured) or tracked (ball/state) ball, whose covariance is shown along the path predicted from it."""
        try:
            self.scene.take_estimate(ball_from_message(message), self.now())
        except TtError as error:
            self.refused(error)

    def on_path(self, path: BallPath) -> None:
        """Show a predicted path of the ball."""
        try:
            self.scene.take_path(path, self.now())
        except TtError as error:
            self.refused(error)

    def on_strokes(self, strokes: StampedStrokes) -> None:
        """Show the candidate strokes: rackets at the time at which they return the ball."""
        self.scene.take_strokes(strokes.rackets, strokes.time, self.now())

    def on_goal(self, message: MultiDOFJointTrajectory) -> None:
        """Show the landing place of a goal of the return."""
        try:
            self.scene.take_goal(goal_from_message(message))
        except TtError as error:
            self.refused(error)

    def on_diagnostics(self, message: DiagnosticArray) -> None:
        """Show where a ball landed, which a simulator reports when the ball is over."""
        self._also(message)
        for status in read_status(message):
            if status.event is Event.BALL_OVER and (place := landing_place(status.values)) is not None:
                self.scene.take_landing(place, self.now())


def landing_place(values: dict[str, str]) -> Array | None:
    """Return where a ball landed, (3,) m in the frame `table`. values: those of the simulator's status "ball over".

    None is returned if the ball did not land, or if the values hold no valid place.
    """
    try:
        row = json.loads(values.get("landing", "null"))
        place = np.array(row[1:4], dtype=float) if row else None
    except (ValueError, TypeError, KeyError):
        return None
    return place if place is not None and place.shape == (3,) and np.isfinite(place).all() else None
