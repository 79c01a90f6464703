"""What track_node, predict_node and racket_node do while the wide cameras follow a ball, by the same functions, each result when it is due.

Pixels and the measured ball go into the tracker when they arrive; from each of its states, `Robot.interval` apart, come path and strokes.
After the strike the return is followed, and flight and return are given to the learner.
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
from tt_predict.learning import ExpectedReturn, PhysicsLearner
from tt_predict.rollout import StopRule, rollout
from tt_predict.state_selection import StateSelection, StateSelectionParams
from tt_racket.followed_ball import FollowedBall
from tt_racket.intercept import Candidates, intercept
from tt_sim.cameras.tracking_cameras import TrackedPixel
from tt_vision.camera import Camera
from tt_vision.rig import CLOCK_SPREAD, WIDE_BIAS, WIDE_NOISE, wide_pair
from tt_vision.tracking import Tracker, TrackerParams

from .scenario import Scenario

JUST_HIT = 0.004  # s around the strike, in which a pixel may be of before or after it
RETURN_SEEN = 0.45  # s after the strike, for which the return is followed: it lands later
KNOWN_SPIN = 1.0  # rad/s, standard deviation of the spin for a robot that takes it as none


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What follows from one state of the ball.

    Attributes:
        state: Of the tracker.
        path: Predicted from there.
        goal: Of the return.
        candidates: Strokes.
        due: s, when the strokes are at the arm.
    """

    state: BallState
    path: BallPath
    goal: ReturnGoal
    candidates: Candidates
    due: float

    @property
    def rackets(self) -> list[RacketState]:
        """The rackets of the strokes, best first."""
        return [stroke.racket for stroke in self.candidates.strokes if stroke.racket]


@functools.cache
def _cameras() -> tuple[Camera, Camera]:
    return wide_pair()


class Follower:
    """The robot's view of one ball from the first pixel to the end of its return.

    Attributes:
        answers: What was derived from states of the ball before the strike, in order of time.
    """

    def __init__(self, scenario: Scenario, learner: PhysicsLearner) -> None:
        """Begin without a ball.

        Args:
            scenario: Whose robot it is.
            learner: What the robot knows of the coefficients; learns if the robot does.
        """
        self._scenario, self._learner = scenario, learner
        self._params = TrackerParams(camera_bias=WIDE_BIAS, clock_spread=CLOCK_SPREAD)
        if scenario.robot.learning:
            self._params = replace(self._params, **_factor_spreads(learner.spreads))
        if scenario.robot.spin == "ignored":
            self._params = replace(self._params, spin_spread=KNOWN_SPIN, spin_weight=1e6)
        self._tracker = Tracker(learner.physics, _cameras(), self._params)
        self._ball = FollowedBall()
        self._inbox, self._order = list[tuple[float, int, BallState | TrackedPixel]](), count()
        self._answer: Answer | None = None
        self._selection = StateSelection(StateSelectionParams(interval=scenario.robot.interval))
        self._newest = self._predicted = -np.inf  # s: stamp of the newest pixel, and time of the last state that was predicted
        self._struck = -np.inf  # s, of the strike
        self._return: tuple[ExpectedReturn, Tracker] | None = None
        self._flight: tuple[Array, Array] | None = None  # logarithms of the factors of this ball and their covariance
        self.answers = list[Answer]()

    def measure(self, ball: BallState, arrival: float) -> None:
        """Take the ball that the fast cameras have measured, which arrives at a time (s)."""
        if self._scenario.robot.spin == "ignored":
            covariance = np.zeros((9, 9)) if ball.covariance is None else ball.covariance.copy()
            covariance[6:], covariance[:, 6:] = 0.0, 0.0
            covariance[6:, 6:] = np.eye(3) * KNOWN_SPIN**2
            ball = BallState(ball.time, ball.position, ball.velocity, np.zeros(3), covariance)
        heappush(self._inbox, (arrival, next(self._order), ball))

    def see(self, pixels: list[TrackedPixel]) -> None:
        """Take pixels, each of which arrives at its time."""
        for one in pixels:
            heappush(self._inbox, (one.arrival, next(self._order), one))

    def answer(self, now: float) -> Answer | None:
        """Return the strokes that come to the arm at a time (s), since the last call; None without new ones."""
        news = False
        while self._inbox and self._inbox[0][0] <= now:
            item = heappop(self._inbox)[2]
            if isinstance(item, BallState):
                self._tracker.start(item)
                news = True
            elif item.stamp < self._struck - JUST_HIT or self._struck == -np.inf:
                self._tracker.add_pixel(item.stamp, item.side, item.pixel, WIDE_NOISE)
                self._newest = max(self._newest, item.stamp)
                news = news or self._newest >= self._predicted + self._scenario.robot.interval
            elif self._return is not None and self._struck + JUST_HIT < item.stamp < self._struck + RETURN_SEEN:
                self._return[1].add_pixel(item.stamp, item.side, item.pixel, WIDE_NOISE)
        if news and self._struck == -np.inf:
            self._predict(now)
        if self._answer is None or self._answer.due > now:
            return None
        answer, self._answer = self._answer, None
        return answer

    def strike(self, racket: RacketState, turning: Array) -> None:
        """Take where the racket was at the strike; turning: (3,) rad/s, its angular velocity."""
        self._struck = racket.time
        if not self._scenario.robot.learning:
            return
        ball = self._tracker.state(racket.time)
        self._flight = self._known_factors()
        expected = self._learner.expect_return(ball, racket, turning) if ball is not None else None
        if expected is not None:
            tracker = Tracker(
                self._tracker.physics, _cameras(), replace(self._params, lag=2.0 * RETURN_SEEN, **_factor_spreads(self._spread))
            )
            tracker.start(expected.ball)
            self._return = expected, tracker

    def finish(self) -> None:
        """Learn from flight and return."""
        if not self._scenario.robot.learning:
            return
        flight = self._flight or self._known_factors()
        if flight is not None:
            self._learner.add_flight(*flight)
        if self._return is not None:
            expected, tracker = self._return
            seen = tracker.state(expected.ball.time)
            if seen is not None and tracker.counts.balls == 1:
                self._learner.add_return(expected, seen)

    @property
    def _spread(self) -> Array:
        """Standard deviations (5,) of the factors of this ball, as far as its flight has told them."""
        factors = self._tracker.factors
        return self._learner.spreads[:5] if factors is None else np.sqrt(np.diag(factors[1]))

    def _known_factors(self) -> tuple[Array, Array] | None:
        return self._tracker.factors if self._tracker.counts.balls > 0 else None

    def _predict(self, now: float) -> None:
        """Derive path and strokes from the newest state, unless it follows the last one too soon."""
        robot, ball = self._scenario.robot, self._tracker.state()
        end = path_end(self._scenario.intercept.x_low)
        if ball is None or ball.velocity[0] >= 0.0 or ball.position[0] <= end or not self._selection.takes(ball):
            return
        physics = self._tracker.physics
        try:
            path = rollout(ball, physics, StopRule.at_x(end))
            goal = self._ball.follow(path, robot.default_goal, self._scenario.goal)
            candidates = self._strokes(path, goal, physics)
        except TtError:  # a first estimate may be no ball that can fly there
            return
        self._predicted = ball.time
        self._answer = Answer(ball, path, goal, candidates, now + robot.reaction)
        self.answers.append(self._answer)

    def _strokes(self, path: BallPath, goal: ReturnGoal, physics: Physics) -> Candidates:
        return intercept(path, goal, physics, self._scenario.intercept, bounced=self._ball.bounced)


def _factor_spreads(spreads: Array) -> dict[str, float]:
    """Return the parameters of a tracker for standard deviations (5 or more,) of the factors."""
    names = ("drag_spread", "lift_spread", "restitution_spread", "friction_spread", "grip_spread")
    return {name: max(1e-3, float(value)) for name, value in zip(names, spreads, strict=False)}
