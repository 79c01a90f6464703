"""The nodes' functions from images to strokes, called on recorded messages without a graph."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

from nav_msgs.msg import Odometry
from tt_core.errors import TtError
from tt_core.failures import Failure
from tt_core.params import from_values
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
Values = Mapping[str, Any]  # parameters of one node by name
Reader = Callable[..., Any]  # read(kind, prefix=""): an instance of a dataclass of parameters


class Output(NamedTuple):
    """A message that a stage makes. topic: relative."""

    topic: str
    kind: str
    message: Any


class Vision:
    """As estimate_node: images and camera_info to ball/measured; first estimates, ball/first, are not made."""

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

    def take(self, topic: str, message: Any) -> Output | None:
        """Take a message of one of `inputs`."""
        burst = self.add(topic, message)
        measured = None if burst is None else self.measure(burst)
        if measured is None:
            return None
        result = measured[1]
        if result.ball is None or result.reason is not None:
            self.refused[_code(result.reason)] += 1
            return None
        return Output("ball/measured", ODOMETRY, ball_to_message(result.ball))

    def add(self, topic: str, message: Any) -> Burst | None:
        """Take a message of one of `inputs`; return the burst if it is complete with it."""
        _, name, what = topic.split("/")
        side = SIDES.index(name)
        if what == "camera_info":
            width, height, matrix, distortion = camera_from_message(message)
            self.lenses[side] = Lens(matrix, distortion, width, height)
            return None
        return self.assembler.add(side, stamp_seconds(message.header.stamp), image_from_message(message))

    def measure(self, burst: Burst) -> tuple[Burst, Measurement] | None:
        """Measure a burst; return it with its calibrated cameras, and the measurement, or None while a calibration is missing."""
        lenses = [lens for lens in (self.lenses[side] for side in self.sides) if lens is not None]
        if len(lenses) < len(self.sides):
            self.refused["no camera_info"] += 1
            return None
        straight = straighten(burst, lenses, [self.poses[side] for side in self.sides])
        return straight, measure_burst(straight, air=self.air, lamps=self.lamps, search=self.search)


class Predict:
    """As predict_node: ball/measured to ball/path."""

    def __init__(self, values: Values) -> None:
        """Read the parameters of the node. Raises TtError for a value that it would refuse."""
        read: Reader = partial(_read, values)
        self.physics, self.stop = read_physics(read), StopRule.at_x(read(PredictParams).until_x)
        self.inputs, self.refused = {"ball/measured"}, Counter[str]()

    def take(self, _: str, message: Odometry) -> Output | None:
        """Take a message of one of `inputs`."""
        path = rollout_past_net(ball_from_message(message), self.physics, self.stop).path
        return Output("ball/path", TRAJECTORY, path_to_message(thinned(path)))


class Racket:
    """As racket_node: ball/path and return/goal to racket/strokes."""

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

    def take(self, topic: str, message: Any) -> Output | None:
        """Take a message of one of `inputs`."""
        if topic == "return/goal":
            self.goal = goal_from_message(message)
            return None
        path = path_from_message(message)
        goal = self.ball.follow(path, self.goal_params, self.goal)
        found = intercept(path, goal, self.physics, self.params, self.relaxation, self.errors, bounced=self.ball.bounced)
        rackets = [stroke.racket for stroke in found.strokes if stroke.racket]
        if not rackets:
            self.refused[_code(found.reason)] += 1
        return Output("racket/strokes", TRAJECTORY, strokes_to_message(rackets, path.times[0]))


STAGES: dict[str, tuple[str, type[Vision] | type[Predict] | type[Racket]]] = {  # node that has the parameters, by the name of the stage
    "vision": ("estimate", Vision),
    "predict": ("predict", Predict),
    "racket": ("racket", Racket),
}


class Chain:
    """Stages one after the other; what one makes is taken by the next.

    Attributes:
        outputs: Relative names of the topics that are made.
        made: How many messages were made, by topic.
        refused: What was not made: how often, by topic of the input and code of the reason.
    """

    def __init__(self, first: str, values: Mapping[str, Values]) -> None:
        """Make the stages from `first`, one of STAGES, on. values: Parameters by name, by node."""
        names = list(STAGES)[list(STAGES).index(first) :]
        self._stages = [STAGES[name][1](values.get(STAGES[name][0], {})) for name in names]
        made = {"vision": "ball/measured", "predict": "ball/path", "racket": "racket/strokes"}
        self.outputs = {made[name] for name in names}
        self.made: Counter[str] = Counter()
        self._errors: Counter[str] = Counter()

    @property
    def inputs(self) -> set[str]:
        """Relative names of the recorded topics that are taken."""
        return {topic for stage in self._stages for topic in stage.inputs} - self.outputs

    @property
    def refused(self) -> Counter[str]:
        """How often nothing was made, by the reason."""
        return sum((stage.refused for stage in self._stages), self._errors)

    def take(self, topic: str, message: Any) -> list[Output]:
        """Take a recorded message, and return all that is made of it. What cannot be used is counted."""
        outputs: list[Output] = []
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
    return from_values(kind, values, prefix)


def _code(reason: Failure | None) -> str:
    return reason.code.name if reason is not None else "UNKNOWN"
