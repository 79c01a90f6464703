"""Publish the path (predicted flight) of the ball for the states of the ball that arrive."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from nav_msgs.msg import Odometry, Path
from rclpy.node import Node
from std_msgs.msg import String
from trajectory_msgs.msg import MultiDOFJointTrajectory
from tt_core.errors import TtError
from tt_core.hit_windows import PATH_END_X
from tt_core.learnt_physics import physics_from_text
from tt_core.params import check, param
from tt_core.priority import RESPONSE
from tt_core.ros.convert import ball_from_message, path_to_bytes, path_to_poses
from tt_core.ros.diagnostics import Event, Status
from tt_core.ros.inputs import PHYSICS_FORM, STATE_FORM, Input
from tt_core.ros.node_main import run
from tt_core.ros.params import declare, declare_physics
from tt_core.ros.qos import LATCHED, RELIABLE
from tt_core.ros.refusals import Refusals
from tt_core.states import BallState

from .net_touch import rollout_past_net
from .rollout import StopRule, rollout, thinned
from .state_selection import StateSelection, StateSelectionParams
from .uncertainty import uncertainty

UNCERTAIN = 0.1  # s, least time between two states for which the uncertainty at the end of the path is computed


class PredictLine(Enum):
    """Messages that the predict node writes to the terminal, as format strings."""

    PATH = "path: bounces {bounces}, {seconds:.2f} s long, ends at x {x:.2f}, y {y:.2f}, z {z:.2f} m"


@dataclass(frozen=True)
class PredictParams:
    """Parameters of the prediction: plane at which a path ends, and whether first estimates of the ball are predicted, too."""

    until_x: float = param(
        PATH_END_X, "m", "x of the plane in `table` at which a path ends; past every hit window of the racket node", low=-100.0, high=100.0
    )
    first: bool = param(False, "", "whether first estimates, ball/first, are predicted, too; a tracker takes them itself")

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


class PredictNode(Node):
    """ROS node that predicts the path of the ball.

    It subscribes to ball/state and publishes ball/path, up to the plane x = `until_x`. The uncertainty at this plane is published on
    /diagnostics. With the parameter `first` the node subscribes to ball/first, too. The same path is published on ball/path_poses in the
    form that viewers draw. Learnt coefficients of the models are taken from the topic `physics`.
    """

    def __init__(self) -> None:
        """Declare parameters, load the kernels, then subscribe."""
        super().__init__("predict")
        self.physics = declare_physics(self)
        self.params = declare(self, PredictParams)
        self.stop = StopRule.at_x(self.params.until_x)
        self.states = StateSelection(declare(self, StateSelectionParams))
        self.at_end_predicted = -math.inf  # s, of the last state whose uncertainty was predicted
        ball = BallState(0.0, np.array([2.6, 0.7, 0.3]), np.array([-5.0, 0.0, 1.0]), np.array([0.0, -300.0, 0.0]))
        rollout(ball, self.physics, self.stop)  # loads the kernels
        uncertainty(BallState.from_vector(0.0, ball.vector, np.eye(9) * 1e-6), self.physics, self.stop)
        self.status = Status(self)
        self.path = self.create_publisher(MultiDOFJointTrajectory, "ball/path", RELIABLE)
        self.poses = self.create_publisher(Path, "ball/path_poses", RELIABLE)
        self.refused = Refusals(self.status, "state")
        self.bad_physics = Refusals(self.status, "physics")
        Input(self, PHYSICS_FORM, "physics", self.on_physics, LATCHED, refused=self.bad_physics)
        topics = {"ball/state": self.on_ball, **({"ball/first": self.on_first} if self.params.first else {})}
        inputs = [Input(self, STATE_FORM, topic, take, RELIABLE, refused=self.refused) for topic, take in topics.items()]
        self.status.wait_for(inputs)

    def on_physics(self, message: String) -> None:
        """Take learnt coefficients of the models; they are used for all states that arrive from now on."""
        try:
            self.physics = physics_from_text(message.data, "predict", self.physics)
        except TtError as error:
            self.bad_physics(error)

    def on_ball(self, message: Odometry) -> None:
        """Predict and publish the path from a state of the ball, and publish the uncertainty at its end on /diagnostics."""
        self.predict(message)

    def on_first(self, message: Odometry) -> None:
        """Predict and publish the path from a first estimate of a ball, without the uncertainty at its end."""
        self.predict(message, first=True)

    def predict(self, message: Odometry, *, first: bool = False) -> None:
        """Predict and publish the path of a ball, if `StateSelection` takes its state and the ball flies towards the robot.

        Args:
            message: State of the ball.
            first: Whether it is a first estimate, which `StateSelection` need not take, and whose uncertainty is not published.
        """
        try:
            ball = ball_from_message(message)
            if ball.velocity[0] >= 0.0 or ball.position[0] <= self.params.until_x or not (first or self.states.takes(ball)):
                return  # it flies away, is past, is nearly the last one, or hardly known
            path, touch = rollout_past_net(ball, self.physics, self.stop)
            shown = thinned(path)
            self.path.publish(path_to_bytes(shown))
            if self.poses.get_subscription_count():
                self.poses.publish(path_to_poses(shown))
        except TtError as error:
            self.refused(error)
            return
        at_end = {} if first else self.at_end(ball)
        self.status.publish(Event.PATH, stamp=ball.time, bounces=len(path.bounces), ended=path.ended, net_touch=touch, **at_end)
        place = dict(zip("xyz", path.end.position, strict=True))
        self.status.terminal.info(PredictLine.PATH, bounces=len(path.bounces), seconds=path.end.time - ball.time, **place)

    def at_end(self, ball: BallState) -> dict[str, Any]:
        """Return how uncertain the end of the ball's predicted path is, as texts for /diagnostics.

        These are the standard deviations of the time (ms) and of y and z (mm), and, as JSON, the covariance (10, 10) of the time (s), the
        position (m), the velocity (m/s) and the spin (rad/s). If the covariance is invalid, the only text is the error. There are no texts
        if the ball has no covariance, or if its time is less than UNCERTAIN (s) after the last ball for which they were computed.
        """
        if ball.covariance is None or 0.0 <= ball.time - self.at_end_predicted < UNCERTAIN:
            return {}
        self.at_end_predicted = ball.time
        try:
            end = uncertainty(ball, self.physics, self.stop)
        except TtError as error:
            return {"reason": error.failure}
        if end is None:
            return {}
        time, _, y, z = 1e3 * np.sqrt(np.diag(end.covariance))[:4]
        rows = json.dumps([[float(f"{value:.4g}") for value in row] for row in end.covariance])
        return {"sigma_time_ms": f"{time:.2f}", "sigma_y_mm": f"{y:.1f}", "sigma_z_mm": f"{z:.1f}", "covariance": rows}


def main() -> None:
    """Run the node."""
    run(PredictNode, RESPONSE)


if __name__ == "__main__":
    main()
