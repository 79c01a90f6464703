"""Publishes the path of the ball for every state of it that arrives."""

from __future__ import annotations

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.node import Node
from trajectory_msgs.msg import MultiDOFJointTrajectory
from tt_core.errors import TtError
from tt_core.ros.convert import ball_from_message, path_to_message
from tt_core.ros.params import declare_physics, parameter
from tt_core.ros.qos import RELIABLE
from tt_core.ros.run import run
from tt_core.ros.status import Status
from tt_core.states import BallState

from .rollout import StopRule, rollout


class PredictNode(Node):
    """/ball/state -> /ball/path up to the plane `until_x`, the end of the robot's reach."""

    def __init__(self) -> None:
        super().__init__("predict")
        self.physics = declare_physics(self)
        self.stop = StopRule.at_x(parameter(self, "until_x", -0.5))
        ball = BallState(0.0, np.array([2.6, 0.7, 0.3]), np.array([-5.0, 0.0, 1.0]), np.array([0.0, -300.0, 0.0]))
        rollout(ball, self.physics, self.stop)  # loads the kernel
        self.status = Status(self)
        self.path = self.create_publisher(MultiDOFJointTrajectory, "/ball/path", RELIABLE)
        self.create_subscription(Odometry, "/ball/state", self.on_ball, RELIABLE)

    def on_ball(self, message: Odometry) -> None:
        try:
            ball = ball_from_message(message)
        except TtError as error:
            self.status.tell(f"state refused: {error}", warn=True)
            return
        path = rollout(ball, self.physics, self.stop)
        self.path.publish(path_to_message(path))
        self.status.tell("path", stamp=ball.time, bounces=len(path.bounces), ended=path.ended)


def main() -> None:
    run(PredictNode)


if __name__ == "__main__":
    main()
