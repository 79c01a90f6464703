"""Read a recorded run and split it into balls: what the nodes published about each ball. Images are read by `ball_images`."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from tt_core.ros.bags import Bag
from tt_core.ros.convert import ball_from_message, goal_from_message, path_from_message, seconds
from tt_core.ros.diagnostics import Event, ReceivedStatus, read_status, read_warnings
from tt_core.states import Array, BallPath, BallState, ReturnGoal
from tt_racket.goal import GoalParams, default_goal

from ..demo_metrics import DemoMetrics, demo_metrics, launched_ball

TOPICS = ("ball/measured", "ball/path", "return/goal", "joint_states", "arm/swing", "diagnostics", "sim/ball", "robot_description")
OLD_NAMES = {"arm_trajectory_controller/joint_trajectory": "arm/swing"}  # present names of topics, by their names in old bags
STAGE_NAMES = {  # stages from the images to the first command, in order: name for people, by the event that ends the stage
    Event.MEASURED: "measuring",
    Event.PATH: "predicting",
    Event.STROKES: "finding strokes",
    Event.FIRST_COMMAND: "planning and first command",
}
BEFORE, AFTER = 0.3, 2.0  # s before and after the measurement of a ball that count as its time if no simulator tells it
SAME_STAMP = 1e-4  # s, largest difference between the stamps of two results of the same burst (the images of one ball)
LATEST_GOAL = 0.8  # s after the launch of a ball; a goal that comes later is for the next ball
MOST_TIME_DIFFERENCE = 0.01  # s, largest difference in time between a measurement and the true state with which it is compared

OVER = {"launched", "result"}  # keys by which a status about a ball that is over is recognized, also in old bags

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class RecordedSwing:
    """A planned swing: the joint motion with which the arm hits the ball.

    Attributes:
        times: (n,) s.
        q: (n, joints) joint positions at these times, rad or m.
        qdot: (n, joints) joint speeds at these times, rad/s or m/s.
        strike: Time at which the racket meets the ball, s.
    """

    times: Array
    q: Array
    qdot: Array
    strike: float


@dataclass(frozen=True, eq=False)
class BallRecord:
    """What was recorded about one ball. A value is None or empty if it did not happen or was not recorded.

    Attributes:
        number: Number of the ball in the run, from 1 on.
        start: Time of its launch, s; without a simulator BEFORE s before its measurement.
        end: Time at which it was over and the swing had ended, s.
        measured: Last measured state of the ball.
        path: Last predicted path of the ball.
        goal: Return that was asked for.
        swing: Last planned swing.
        joints: (n, 1 + 2 joints) joint states from start to end; each row is time (s), positions (rad or m), speeds (rad/s or m/s).
        truth: (n, 4) true states of the ball from start to end; each row is time (s) and position (m).
        latencies: Time from the last camera image to the end of each stage, ms, by the event of STAGE_NAMES.
        warnings: Warnings of the nodes during this time, each once.
        metrics: Comparison of what was true, measured, asked for and reached; None if no simulator tells the truth.
    """

    number: int
    start: float
    end: float
    measured: BallState | None
    path: BallPath | None
    goal: ReturnGoal | None
    swing: RecordedSwing | None
    joints: Array
    truth: Array
    latencies: Mapping[Event, float]
    warnings: Sequence[str]
    metrics: DemoMetrics | None

    @property
    def title(self) -> str:
        """Title for people, e.g. "Ball 1: top 3"."""
        return f"Ball {self.number}" + (f": {self.metrics.kind}" if self.metrics else "")

    @property
    def reason(self) -> str | None:
        """Why the ball was not returned; None if it was returned, or if that is not known."""
        if self.metrics is not None:
            return self.metrics.reason
        if self.measured is None or self.swing is None:
            return "; ".join(self.warnings) or "no swing"
        return None


@dataclass(frozen=True, eq=False)
class RunRecord:
    """What was recorded about a run.

    Attributes:
        bag: Path of the recording.
        balls: The balls of the run, in the order of time.
        joint_names: Names of the joints, in the order of `BallRecord.joints`.
        urdf: URDF of the robot; "" if it was not recorded.
    """

    bag: Path
    balls: Sequence[BallRecord]
    joint_names: Sequence[str]
    urdf: str

    @classmethod
    def read(cls, path: Path) -> RunRecord:
        """Read a recording, a bag of any kind.

        Raises:
            BagError: The bag cannot be read, or holds several robots.
            TtError: A message has content that the nodes do not publish.
        """
        messages = _Messages()
        with Bag(path) as bag:
            names = {bag.find(name): OLD_NAMES.get(name, name) for name in (*TOPICS, *OLD_NAMES)}
            for message in bag.messages([name for name in names if name]):
                messages.take(names[message.topic], bag.decode(message))
        return cls(path, messages.balls(), messages.joint_names, messages.urdf)


@dataclass
class _Messages:
    """The recorded messages, converted, in the order of arrival."""

    measured: list[BallState] = field(default_factory=list)
    paths: list[BallPath] = field(default_factory=list)
    goals: list[tuple[float, ReturnGoal]] = field(default_factory=list)
    swings: list[RecordedSwing] = field(default_factory=list)
    joints: list[list[float]] = field(default_factory=list)
    truth: list[BallState] = field(default_factory=list)
    statuses: list[ReceivedStatus] = field(default_factory=list)
    warnings: list[ReceivedStatus] = field(default_factory=list)
    joint_names: Sequence[str] = ()
    urdf: str = ""

    def take(self, topic: str, message: Any) -> None:
        """Convert and keep a message. topic: one of TOPICS."""
        match topic:
            case "ball/measured":
                self.measured.append(ball_from_message(message))
            case "ball/path":
                self.paths.append(path_from_message(message))
            case "return/goal":
                self.goals.append((seconds(message.header.stamp), goal_from_message(message)))
            case "sim/ball":
                self.truth.append(ball_from_message(message))
            case "joint_states":
                self.joint_names = self.joint_names or list(message.name)
                if list(message.name) == list(self.joint_names):
                    self.joints.append([seconds(message.header.stamp), *message.position, *message.velocity])
            case "arm/swing":
                self.swings.append(_swing(message))
            case "diagnostics":
                self.statuses += read_status(message)
                self.warnings += read_warnings(message)
            case "robot_description":
                self.urdf = message.data

    def balls(self) -> list[BallRecord]:
        """Return the balls of the run: those that the simulator launched, or without a simulator those that were measured."""
        overs = [status for status in self.statuses if status.values.keys() >= OVER]
        spans: list[tuple[float, float, dict[str, str]]]
        if overs:
            spans = [(launched_ball(status.values).time, status.time, status.values) for status in overs]
        else:
            spans = [(ball.time - BEFORE, ball.time + AFTER, {}) for ball in self.measured]
        width = 1 + 2 * len(self.joint_names)
        joints = np.array([row for row in self.joints if len(row) == width]).reshape(-1, width)
        truth = np.array([[ball.time, *ball.position] for ball in self.truth]).reshape(-1, 4)
        for statuses in (self.statuses, self.warnings):
            statuses.sort(key=_time)  # nodes of several machines may have sent them out of order
        nexts = [start for start, *_ in spans[1:]] + [np.inf]
        return [
            self._ball(number, _Span(start, over, following), outcome, joints, truth)
            for number, ((start, over, outcome), following) in enumerate(zip(spans, nexts, strict=False), 1)
        ]

    def _ball(self, number: int, span: _Span, outcome: dict[str, str], joints: Array, truth: Array) -> BallRecord:
        """Collect what was recorded about one ball.

        Args:
            number: Number of the ball.
            span: When it was in play.
            outcome: Values of the simulator's report on the ball; empty without a simulator.
            joints: (n, 1 + 2 joints) all joint states, as in BallRecord.
            truth: (n, 4) all true states, as in BallRecord.
        """
        measured = _last([ball for ball in self.measured if span.holds(ball.time)])
        path = _last([path for path in self.paths if span.holds(path.times[0])])
        swing = _last([swing for swing in self.swings if span.holds(swing.times[0])])
        statuses = _within(self.statuses, span)
        warnings = [f"{status.name}: {status.message}" for status in _within(self.warnings, span)]
        strikes = [float(status.values["strike"]) for status in statuses if "strike" in status.values]
        if swing is not None and strikes:
            swing = replace(swing, strike=strikes[-1])
        latencies = _latencies(statuses, measured)
        goal = _last([goal for time, goal in self.goals if time < span.start + LATEST_GOAL])
        if goal is None and measured is not None:
            goal = default_goal(measured.spin, GoalParams())
        end = min(span.following, max(span.over, swing.times[-1] if swing is not None else span.over))
        metrics = None
        if outcome and goal is not None:
            first_command = latencies.get(Event.FIRST_COMMAND)
            metrics = demo_metrics(outcome, goal, measured, first_command, _last(warnings), self._true(measured, truth[:, 0]))
        return BallRecord(
            number=number,
            start=span.start,
            end=end,
            measured=measured,
            path=path,
            goal=goal,
            swing=swing,
            joints=joints[(joints[:, 0] >= span.start) & (joints[:, 0] <= end)],
            truth=truth[(truth[:, 0] >= span.start) & (truth[:, 0] <= end)],
            latencies=latencies,
            warnings=list(dict.fromkeys(warnings)),
            metrics=metrics,
        )

    def _true(self, measured: BallState | None, times: Array) -> BallState | None:
        """Return the recorded true ball nearest in time to a measurement; None beyond MOST_TIME_DIFFERENCE. times: of `truth`, s."""
        if measured is None or not len(times):
            return None
        after = int(np.searchsorted(times, measured.time))
        nearest = min(self.truth[max(0, after - 1) : after + 1], key=lambda ball: abs(ball.time - measured.time))
        return nearest if abs(nearest.time - measured.time) < MOST_TIME_DIFFERENCE else None


class _Span(NamedTuple):
    """When a ball was in play, s: its start, its end (`over`), and the start of the ball that follows."""

    start: float
    over: float
    following: float

    def holds(self, time: float) -> bool:
        """Return whether a time (s) belongs to this ball: not before its start, and before the next ball."""
        return self.start <= time < self.following


def _time(status: ReceivedStatus) -> float:
    return status.time


def _within(statuses: Sequence[ReceivedStatus], span: _Span) -> Sequence[ReceivedStatus]:
    """Return those statuses whose time belongs to a span. The statuses must be sorted by time."""
    return statuses[bisect_left(statuses, span.start, key=_time) : bisect_left(statuses, span.following, key=_time)]


def _last(values: Sequence[T]) -> T | None:
    return values[-1] if values else None


def _latencies(statuses: Sequence[ReceivedStatus], measured: BallState | None) -> dict[Event, float]:
    """Return the latency (ms) of the first result of each stage for a measured ball. Measuring ends with the first estimate, if any."""
    found: dict[Event, float] = {}
    for status in statuses:
        event = Event.MEASURED if status.event is Event.FIRST_ESTIMATE else status.event
        if event not in STAGE_NAMES or "latency_ms" not in status.values or event in found:
            continue
        if measured is None or abs(float(status.values.get("stamp", measured.time)) - measured.time) < SAME_STAMP:
            found[event] = float(status.values["latency_ms"])
    return found


def _swing(message: Any) -> RecordedSwing:
    start = seconds(message.header.stamp)
    times = np.array([start + seconds(point.time_from_start) for point in message.points])
    q, qdot = (np.array([getattr(point, name) for point in message.points]) for name in ("positions", "velocities"))
    return RecordedSwing(times, q, qdot, float(times[np.argmax(np.abs(qdot).max(axis=1))]))
