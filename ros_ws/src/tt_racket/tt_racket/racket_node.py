"""Publish the strokes (racket position, orientation and velocity at one time) that return each predicted ball to the goal."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from rclpy.node import Node
from std_msgs.msg import String
from trajectory_msgs.msg import MultiDOFJointTrajectory
from tt_core.errors import TtError
from tt_core.hit_windows import HIT_WINDOWS
from tt_core.learnt_physics import physics_from_text
from tt_core.params import check, param
from tt_core.priority import RESPONSE
from tt_core.robots import read_arm
from tt_core.ros.convert import goal_from_message, strokes_to_bytes
from tt_core.ros.diagnostics import Event, Status
from tt_core.ros.inputs import GOAL_FORM, PATH_FORM, PHYSICS_FORM, Input
from tt_core.ros.node_main import run
from tt_core.ros.params import declare, declare_physics
from tt_core.ros.qos import LATCHED, LATEST, RELIABLE
from tt_core.ros.refusals import Refusals
from tt_core.states import BallPath, BallState, ReturnGoal

from .followed_ball import FollowedBall
from .goal import GoalParams, default_goal
from .goal_relaxation import RelaxationParams
from .intercept import InterceptParams, intercept
from .sensitivity import StrikeErrorParams, landing_rms
from .stroke import solve


class RacketLine(Enum):
    """Messages that the racket node writes to the terminal, as format strings."""

    STROKES = (
        "{count} strokes; the best hits at x {x:.2f}, y {y:.2f}, z {z:.2f} m with {speed:.1f} m/s; to land at {landing[0]:.2f}, "
        "{landing[1]:.2f} m after {seconds:.2f} s, {relaxed}"
    )
    NO_STROKE = "no stroke: {reason}"


@dataclass(frozen=True)
class RacketParams:
    """Parameters that choose the arm and the default hit window, the box in which the ball may be hit."""

    robot: str = param("", "", "name of an arm, or path of an arm file or its folder, see docs/arms.md; empty: pa10")
    window: str = param(
        "robot",
        "",
        "default hit window: that of the arm file, near the table, or all that the PA10 reaches",
        choices=("robot", "near", "reachable"),
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)

    @property
    def intercept(self) -> InterceptParams:
        """Default values of the parameters of the search for strokes: window and racket speed are those of arm file and `window`.

        Raises BadFile if the arm file cannot be used.
        """
        arm, _ = read_arm(self.robot)
        return InterceptParams.of(arm.hit_window if self.window == "robot" else HIT_WINDOWS[self.window], arm.racket_speed)


class RacketNode(Node):
    """ROS node that computes the strokes for each predicted path of the ball.

    It subscribes to ball/path, return/goal and physics, and publishes racket/strokes. Until a goal arrives, it uses the default goal for
    the spin of the ball.
    """

    def __init__(self) -> None:
        """Declare parameters, load the kernels, then subscribe."""
        super().__init__("racket")
        self.physics = declare_physics(self)
        self.params = declare(self, declare(self, RacketParams).intercept)
        self.goal_params = declare(self, GoalParams, "goal.", changed=self.on_goal_params)
        self.relaxation = declare(self, RelaxationParams, "relaxation.")
        self.errors = declare(self, StrikeErrorParams, "errors.")
        self.goal: ReturnGoal | None = None
        self.ball = FollowedBall()
        ball = BallState(0.0, np.array([-0.15, 0.7, 0.25]), np.array([-4.0, 0.0, 0.3]), np.array([0.0, -150.0, 0.0]))
        goal = default_goal(ball.spin, self.goal_params)
        BallPath(np.zeros(1), ball.position[None], ball.velocity[None], ball.spin[None]).at(0.0)  # loads its kernel
        landing_rms(ball, solve(ball, goal, self.physics), goal.flight_time, self.physics, self.errors)
        self.status = Status(self)
        self.strokes = self.create_publisher(MultiDOFJointTrajectory, "racket/strokes", LATEST)
        self.bad_goals, self.bad_paths = Refusals(self.status, "goal"), Refusals(self.status, "path")
        Input(self, GOAL_FORM, "return/goal", self.on_goal, LATCHED, refused=self.bad_goals)
        self.bad_physics = Refusals(self.status, "physics")
        Input(self, PHYSICS_FORM, "physics", self.on_physics, LATCHED, refused=self.bad_physics)
        paths = Input(self, PATH_FORM, "ball/path", self.on_path, RELIABLE, refused=self.bad_paths)
        self.status.wait_for([paths])

    def on_goal_params(self, params: GoalParams) -> None:
        """Use the changed parameters of the default goal; a ball whose default goal is already settled keeps it."""
        self.goal_params = params

    def on_goal(self, message: MultiDOFJointTrajectory) -> None:
        """Take the goal of a message; it is used for all paths that arrive from now on. Refuse a message without a valid goal."""
        try:
            self.goal = goal_from_message(message)
        except TtError as error:
            self.bad_goals(error)

    def on_physics(self, message: String) -> None:
        """Take learnt coefficients of the models; they are used for all paths that arrive from now on."""
        try:
            self.physics = physics_from_text(message.data, "racket", self.physics)
        except TtError as error:
            self.bad_physics(error)

    def on_path(self, path: BallPath) -> None:
        """Find the strokes for a predicted path, and publish them and a status. A path that raises an error is refused."""
        try:
            goal = self.ball.follow(path, self.goal_params, self.goal)
            found = intercept(path, goal, self.physics, self.params, self.relaxation, self.errors, bounced=self.ball.bounced)
            rackets = [stroke.racket for stroke in found.strokes if stroke.racket]
            self.strokes.publish(strokes_to_bytes(rackets, path.times[0]))
        except TtError as error:
            self.bad_paths(error)
            return
        self.status.publish(
            Event.STROKES,
            stamp=path.times[0],
            warn=not rackets,
            reason=found.reason,
            found=len(rackets),
            relaxed=found.relaxed[0] if found.relaxed else "",
            refused="; ".join(sorted({str(failure) for _, failure in found.refused})),
        )
        if not rackets:
            self.status.terminal.warn(RacketLine.NO_STROKE, reason=found.reason)
            return
        self.status.terminal.info(
            RacketLine.STROKES,
            count=len(rackets),
            speed=np.linalg.norm(rackets[0].velocity),
            landing=goal.landing,
            seconds=goal.flight_time,
            relaxed=found.relaxed[0],
            **dict(zip("xyz", rackets[0].position, strict=True)),
        )


def main() -> None:
    """Run the node."""
    run(RacketNode, RESPONSE)


if __name__ == "__main__":
    main()
