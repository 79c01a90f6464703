"""Stages of the robot from images to strokes: what the nodes estimate, predict and racket compute, without ROS, on recorded messages.

A stroke is position, orientation and velocity of the racket at the time at which it returns the ball.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

from nav_msgs.msg import Odometry
from tt_core.errors import TtError
from tt_core.failures import Failure
from tt_core.params import params_from_values
from tt_core.ros.convert import (
    ball_from_message,
    ball_to_message,
    camera_from_message,
    goal_from_message,
    image_from_message,
    path_from_message,
    path_to_message,
    stamp_seconds,
    strokes_to_message,
)
from tt_core.ros.params import read_physics
from tt_core.states import ReturnGoal
from tt_predict.net_touch import rollout_past_net
from tt_predict.predict_node import PredictParams
from tt_predict.rollout import StopRule, thinned
from tt_racket.followed_ball import FollowedBall
from tt_racket.goal import GoalParams
from tt_racket.goal_relaxation import RelaxationParams
from tt_racket.intercept import intercept
from tt_racket.racket_node import RacketParams
from tt_racket.sensitivity import StrikeErrorParams
from tt_vision.capture.assembler import Assembler, BurstParams
from tt_vision.capture.burst import Burst
from tt_vision.detection.lens_correction import Lens, straighten
from tt_vision.estimate_node import EstimateParams, read_lamps, read_poses
from tt_vision.measure import Measurement, measure_burst
from tt_vision.rig import SIDES

ODOMETRY, TRAJECTORY = "nav_msgs/msg/Odometry", "trajectory_msgs/msg/MultiDOFJointTrajectory"
Values = Mapping[str, Any]  # parameter values of one node, by name
Reader = Callable[..., Any]  # read(kind, prefix="") returns an instance of a dataclass of parameters


class StageOutput(NamedTuple):
    """A message that a stage has made.

    Attributes:
        topic: Relative name of its topic, e.g. "ball/path".
        kind: Message type, e.g. "nav_msgs/msg/Odometry".
        message: The message.
    """

    topic: str
    kind: str
    message: Any


class Vision:
    """Stage that measures balls as estimate_node does: from camera images and camera_info to ball/measured.

    The quick first estimates that the node publishes on ball/first are not made.

    Attributes:
        inputs: Relative names of the topics whose messages `take` needs.
        refused: How often no ball was measured, by the code of the reason, or by "no camera_info" while a calibration is missing.
        sides: Index in SIDES of each camera that is used.
    """

    def __init__(self, values: Values) -> None:
        """Read the parameters of the node. Raises TtError for a value that it would refuse."""
        read: Reader = partial(_read, values)
        self.assembler = Assembler(read(BurstParams))
        self.search = read(EstimateParams).search
        self.air, self.lamps, self.poses = read_physics(read).air, read_lamps(read), read_poses(read)
        self.lenses: list[Lens | None] = [None, None]
        self.refused: Counter[str] = Counter()
        alone = self.assembler.params.alone
        self.sides = [SIDES.index(alone)] if alone else [0, 1]
        self.inputs = {f"camera/{name}/{what}" for name in SIDES for what in ("image_raw", "camera_info")}

    def take(self, topic: str, message: Any) -> StageOutput | None:
        """Process a message of one of the topics `inputs`. Return the measured ball if the message completes one, otherwise None."""
        burst = self.add(topic, message)
        measured = None if burst is None else self.measure(burst)
        if measured is None:
            return None
        _, result = measured
        if result.ball is None or result.reason is not None:
            self.refused[_code(result.reason)] += 1
            return None
        return StageOutput("ball/measured", ODOMETRY, ball_to_message(result.ball))

    def add(self, topic: str, message: Any) -> Burst | None:
        """Add a message of one of the topics `inputs`, and return the burst if the message completes one, otherwise None.

        A burst is the images of one ball's passage through the high-speed cameras.
        """
        _, name, what = topic.split("/")
        side = SIDES.index(name)
        if what == "camera_info":
            width, height, matrix, distortion = camera_from_message(message)
            self.lenses[side] = Lens(matrix, distortion, width, height)
            return None
        return self.assembler.add(side, stamp_seconds(message.header.stamp), image_from_message(message))

    def measure(self, burst: Burst) -> tuple[Burst, Measurement] | None:
        """Measure position, velocity and spin of the ball in a burst.

        Returns:
            The burst with its calibrated cameras, and the measurement; None while the calibration of a camera has not arrived.
        """
        lenses = [lens for lens in (self.lenses[side] for side in self.sides) if lens is not None]
        if len(lenses) < len(self.sides):
            self.refused["no camera_info"] += 1
            return None
        straight = straighten(burst, lenses, [self.poses[side] for side in self.sides])
        return straight, measure_burst(straight, air=self.air, lamps=self.lamps, search=self.search)


class Predict:
    """Stage that predicts the flight of the ball as predict_node does: from ball/measured to ball/path.

    Attributes:
        inputs: Relative names of the topics whose messages `take` needs.
        refused: Always empty, because every measured ball gets a path.
    """

    def __init__(self, values: Values) -> None:
        """Read the parameters of the node. Raises TtError for a value that it would refuse."""
        read: Reader = partial(_read, values)
        self.physics, self.stop = read_physics(read), StopRule.at_x(read(PredictParams).until_x)
        self.inputs, self.refused = {"ball/measured"}, Counter[str]()

    def take(self, _: str, message: Odometry) -> StageOutput | None:
        """Return the predicted path of a measured ball."""
        path = rollout_past_net(ball_from_message(message), self.physics, self.stop).path
        return StageOutput("ball/path", TRAJECTORY, path_to_message(thinned(path)))


class Racket:
    """Stage that finds strokes as racket_node does: from ball/path and return/goal to racket/strokes.

    Attributes:
        inputs: Relative names of the topics whose messages `take` needs.
        refused: How often no stroke was found, by the code of the reason.
    """

    def __init__(self, values: Values) -> None:
        """Read the parameters of the node. Raises TtError for a value that it would refuse."""
        read: Reader = partial(_read, values)
        self.physics = read_physics(read)
        self.params = read(read(RacketParams).intercept)
        self.goal_params, self.relaxation = read(GoalParams, "goal."), read(RelaxationParams, "relaxation.")
        self.errors = read(StrikeErrorParams, "errors.")
        self.goal: ReturnGoal | None = None
        self.ball = FollowedBall()
        self.inputs, self.refused = {"ball/path", "return/goal"}, Counter[str]()

    def take(self, topic: str, message: Any) -> StageOutput | None:
        """Process a message of one of the topics `inputs`. Return the strokes for a path, which may be none; None for a goal."""
        if topic == "return/goal":
            self.goal = goal_from_message(message)
            return None
        path = path_from_message(message)
        goal = self.ball.follow(path, self.goal_params, self.goal)
        found = intercept(path, goal, self.physics, self.params, self.relaxation, self.errors, bounced=self.ball.bounced)
        rackets = [stroke.racket for stroke in found.strokes if stroke.racket]
        if not rackets:
            self.refused[_code(found.reason)] += 1
        return StageOutput("racket/strokes", TRAJECTORY, strokes_to_message(rackets, path.times[0]))


STAGES: dict[str, tuple[str, type[Vision] | type[Predict] | type[Racket]]] = {  # by name: the node that has the parameters, and the class
    "vision": ("estimate", Vision),
    "predict": ("predict", Predict),
    "racket": ("racket", Racket),
}


class StageChain:
    """A sequence of stages, each of which processes the messages that the one before it has made.

    Attributes:
        outputs: Relative names of the topics on which the stages make messages.
        made: Number of messages that were made, by topic.
    """

    def __init__(self, first: str, values: Mapping[str, Values]) -> None:
        """Make a stage and all that follow it.

        Args:
            first: Name of the first stage, one of STAGES.
            values: Parameter values by name, for each node by its name.

        Raises:
            TtError: A parameter has a value that its node would refuse.
        """
        names = list(STAGES)[list(STAGES).index(first) :]
        self._stages = [STAGES[name][1](values.get(STAGES[name][0], {})) for name in names]
        made = {"vision": "ball/measured", "predict": "ball/path", "racket": "racket/strokes"}
        self.outputs = {made[name] for name in names}
        self.made: Counter[str] = Counter()
        self._errors: Counter[str] = Counter()

    @property
    def inputs(self) -> set[str]:
        """Relative names of the recorded topics whose messages `take` needs."""
        return {topic for stage in self._stages for topic in stage.inputs} - self.outputs

    @property
    def refused(self) -> Counter[str]:
        """How often a stage made nothing, by the code of the reason, or by topic and name of the error for an unusable message."""
        return sum((stage.refused for stage in self._stages), self._errors)

    def take(self, topic: str, message: Any) -> list[StageOutput]:
        """Process a recorded message by all stages, and return the messages that they make. A message that cannot be used is counted.

        Args:
            topic: Relative name of its topic, one of `inputs`.
            message: The message.
        """
        outputs: list[StageOutput] = []
        for stage in self._stages:
            if topic not in stage.inputs:
                continue
            try:
                output = stage.take(topic, message)
            except TtError as error:
                self._errors[f"{topic}: {type(error).__name__}"] += 1
                break
            if output is None:
                break
            outputs.append(output)
            self.made[output.topic] += 1
            topic, message = output.topic, output.message
        return outputs


def _read(values: Values, kind: Any, prefix: str = "") -> Any:
    return params_from_values(kind, values, prefix)


def _code(reason: Failure | None) -> str:
    return reason.code.name if reason is not None else "UNKNOWN"
