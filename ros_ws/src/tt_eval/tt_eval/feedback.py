"""Simulation of track_node, predict_node and racket_node while the wide cameras see a ball, with the same functions and with delays.

Pixels and the measured ball are given to the tracker when they arrive. From its states, at least `Robot.interval` apart, path (the
predicted flight) and strokes (racket states that return the ball) are computed. After the strike the return is tracked, and flight and
return are given to the learner.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from heapq import heappop, heappush
from itertools import count

import numpy as np
from tt_core.errors import TtError
from tt_core.hit_windows import path_end
from tt_core.physics import Physics
from tt_core.states import Array, BallPath, BallState, RacketState, ReturnGoal
from tt_predict.learning import PhysicsLearner
from tt_predict.net_touch import rollout_past_net
from tt_predict.rollout import StopRule
from tt_predict.state_selection import StateSelection, StateSelectionParams
from tt_racket.followed_ball import FollowedBall
from tt_racket.intercept import Candidates, intercept
from tt_sim.cameras.tracking_cameras import TrackedPixel
from tt_vision.camera import Camera
from tt_vision.rig import CLOCK_SPREAD, WIDE_BIAS, WIDE_NOISE, wide_pair
from tt_vision.tracking import Tracker, TrackerParams

from .lesson import Lesson
from .scenario import Scenario

KNOWN_SPIN = 1.0  # rad/s, standard deviation of the spin for a robot that assumes no spin


@dataclass(frozen=True, slots=True, eq=False)
class BallResponse:
    """What the robot computes from one state of the ball.

    Attributes:
        state: State of the ball from the tracker.
        path: Flight predicted from it.
        goal: Goal of the return.
        candidates: Strokes.
        due: s, when the strokes arrive at the arm.
    """

    state: BallState
    path: BallPath
    goal: ReturnGoal
    candidates: Candidates
    due: float

    @property
    def rackets(self) -> list[RacketState]:
        """The states of the racket of the strokes, best first."""
        return [stroke.racket for stroke in self.candidates.strokes if stroke.racket]


@functools.cache
def _cameras() -> tuple[Camera, Camera]:
    return wide_pair()


class Follower:
    """The robot's tracker, prediction and strokes for one ball, from the first pixel to the end of its return.

    Attributes:
        responses: What was computed from states of the ball before the strike, in the order of time.
    """

    def __init__(self, scenario: Scenario, learner: PhysicsLearner) -> None:
        """Start without a ball.

        Args:
            scenario: Scenario with the robot's models and methods.
            learner: What the robot knows of the coefficients of air, table and rubber. It learns if the robot does.
        """
        self._scenario = scenario
        params = TrackerParams(camera_bias=WIDE_BIAS, clock_spread=CLOCK_SPREAD)
        if scenario.robot.spin == "ignored":
            params = replace(params, spin_spread=KNOWN_SPIN, spin_weight=1e6)
        self._lesson = Lesson(learner, _cameras(), params) if scenario.robot.learning else None
        self._tracker = self._lesson.tracker if self._lesson else Tracker(learner.physics, _cameras(), params)
        self._ball = FollowedBall()
        self._inbox, self._order = list[tuple[float, int, BallState | TrackedPixel]](), count()
        self._response: BallResponse | None = None
        self._selection = StateSelection(StateSelectionParams(interval=scenario.robot.interval, patience=scenario.robot.patience))
        self._newest = self._predicted = -np.inf  # s: stamp of the newest pixel, and time of the last state that was predicted
        self._struck = False
        self.responses = list[BallResponse]()

    def measure(self, ball: BallState, arrival: float) -> None:
        """Add the ball that the high-speed cameras have measured.

        Args:
            ball: The measured ball.
            arrival: s, when it arrives at the tracker.
        """
        if self._scenario.robot.spin == "ignored":
            covariance = np.zeros((9, 9)) if ball.covariance is None else ball.covariance.copy()
            covariance[6:], covariance[:, 6:] = 0.0, 0.0
            covariance[6:, 6:] = np.eye(3) * KNOWN_SPIN**2
            ball = BallState(ball.time, ball.position, ball.velocity, np.zeros(3), covariance)
        heappush(self._inbox, (arrival, next(self._order), ball))

    def see(self, pixels: list[TrackedPixel]) -> None:
        """Add pixels of the wide cameras, each of which arrives at the tracker at its own time."""
        for one in pixels:
            heappush(self._inbox, (one.arrival, next(self._order), one))

    def response(self, now: float) -> BallResponse | None:
        """Process what has arrived until a time, and return the strokes that are at the arm then.

        Args:
            now: s.

        Returns:
            The newest strokes that were not returned before; None if there are none.
        """
        news = False
        while self._inbox and self._inbox[0][0] <= now:
            _, _, item = heappop(self._inbox)
            if isinstance(item, BallState):
                self._tracker.start(item)
                news = True
            elif self._takes(item):
                self._newest = max(self._newest, item.stamp)
                news = news or self._newest >= self._predicted + self._scenario.robot.interval
        if news and not self._struck:
            self._predict(now)
        if self._response is None or self._response.due > now:
            return None
        response, self._response = self._response, None
        return response

    def strike(self, racket: RacketState, turning: Array) -> None:
        """Note the contact of racket and ball.

        Args:
            racket: The racket at the contact.
            turning: (3,) rad/s in `table`, its angular velocity.
        """
        self._struck = True
        if self._lesson is not None:
            self._lesson.strike(racket, turning)

    def finish(self) -> None:
        """Give flight and return of the ball to the learner if the robot learns."""
        if self._lesson is not None:
            self._lesson.finish()

    def _takes(self, seen: TrackedPixel) -> bool:
        """Give a pixel to the tracker; return whether it is from before the strike."""
        if self._lesson is not None:
            return self._lesson.add_pixel(seen.stamp, seen.side, seen.pixel)
        if not self._struck:
            self._tracker.add_pixel(seen.stamp, seen.side, seen.pixel, WIDE_NOISE)
        return not self._struck

    def _predict(self, now: float) -> None:
        """Compute path and strokes from the newest state, unless it follows the last one too soon."""
        robot, ball = self._scenario.robot, self._tracker.state()
        end = path_end(self._scenario.intercept.x_low)
        if ball is None or ball.velocity[0] >= 0.0 or ball.position[0] <= end or not self._selection.takes(ball):
            return
        physics = self._tracker.physics
        try:
            path = rollout_past_net(ball, physics, StopRule.at_x(end)).path
            goal = self._ball.follow(path, robot.default_goal, self._scenario.goal)
            candidates = self._strokes(path, goal, physics)
        except TtError:  # a first estimate may be no ball that can fly there
            return
        self._predicted = ball.time
        self._response = BallResponse(ball, path, goal, candidates, now + robot.reaction)
        self.responses.append(self._response)

    def _strokes(self, path: BallPath, goal: ReturnGoal, physics: Physics) -> Candidates:
        return intercept(path, goal, physics, self._scenario.intercept, bounced=self._ball.bounced)
