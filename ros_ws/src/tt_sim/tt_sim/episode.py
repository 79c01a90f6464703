"""One ball from launch to landing without ROS: what the nodes do, by the same functions in the same order, deterministic by seed."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from tt_arm.choice import Choice
from tt_arm.control import ArmControl
from tt_arm.model import ArmModel
from tt_arm.swing import Joints
from tt_core.errors import TtError, check_range
from tt_core.flight import fly
from tt_core.physics import Physics
from tt_core.states import Array, BallPath, BallState, ReturnGoal
from tt_predict.rollout import StopRule, rollout
from tt_racket.goal import GoalParams, answer
from tt_racket.intercept import Candidates, InterceptParams, intercept
from tt_vision.burst import Assembler
from tt_vision.measure import Measurement, measure
from tt_vision.rig import high_speed_pair

from .footage import footage
from .hardware import Hardware
from .launcher import KINDS, LauncherParams, launch
from .outcome import Outcome
from .plant import Plant, PlantParams
from .render import Scene, Texture

UNTIL_X = -0.5  # m, how far the path is predicted
LONGEST = 4.0  # s, simulated, after which a ball is given up


@dataclass(frozen=True)
class Scenario:
    """What is played. truth: the world's physics; believed: the robot's. goal: None answers the measured spin (`tt_racket.goal`).

    latency: s from the middle of the last frame's exposure to the strokes at the arm. tick: s between two joint states.
    """

    kind: str = "top"
    scale: int = 3
    goal: ReturnGoal | None = None
    truth: Physics = field(default_factory=Physics.liu)
    believed: Physics = field(default_factory=Physics.liu)
    launcher: LauncherParams = field(default_factory=LauncherParams)
    plant: PlantParams = field(default_factory=PlantParams)
    intercept: InterceptParams = field(default_factory=InterceptParams)
    latency: float = 0.06
    tick: float = 0.002

    def __post_init__(self) -> None:
        check_range("latency", self.latency, 0.0, 2.0)
        check_range("tick", self.tick, 5e-4, 0.02)
        if self.kind not in KINDS:
            raise TtError(f"kind {self.kind!r} is none of {', '.join(KINDS)}")


@dataclass(frozen=True, eq=False)
class Episode:
    """Everything that happened, as far as it came. joints: (n, 15) time s, q rad, qdot rad/s of every tick."""

    outcome: Outcome
    goal: ReturnGoal | None
    measurement: Measurement | None
    path: BallPath | None
    candidates: Candidates | None
    choice: Choice | None
    joints: Array

    @property
    def reason(self) -> str | None:
        """Why the ball did not come back, from the first stage that failed; None when it landed on the opponent's half."""
        if self.outcome.result == "returned":
            return None
        if self.measurement is None:
            return "not seen"
        if self.measurement.ball is None:
            return f"measurement refused: {self.measurement.reason}"
        if self.candidates is None or not self.candidates.strokes:
            refused = {reason for _, reason in self.candidates.refused} if self.candidates else set()
            return f"no stroke: {'; '.join(sorted(refused)) or 'the ball does not come within reach'}"
        if self.choice is None or self.choice.index is None:
            return f"arm: {self.choice.reasons[0] if self.choice and self.choice.reasons else 'no swing'}"
        return self.outcome.result


def _see(scenario: Scenario, ball: BallState, orientation: Array, rng: np.random.Generator, seed: int) -> Measurement | None:
    cameras, assembler = high_speed_pair(), Assembler()
    for frame in footage(ball, orientation, cameras, Scene(texture=Texture.drawn(seed)), scenario.truth, rng):
        for side, image in enumerate(frame.images):
            burst = assembler.add(side, frame.time, image)
            if burst is not None:
                return measure(burst.left, burst.right, burst.times, cameras)
    return None


def play(scenario: Scenario, seed: int) -> Episode:
    """The whole rally of one ball. Raises TtError for a scenario that cannot be played."""
    rng = np.random.default_rng(seed)
    ball, orientation = launch(scenario.kind, scenario.scale, scenario.launcher, rng)
    goal, path, candidates, choice, strokes_due = None, None, None, None, np.inf
    measurement = _see(scenario, ball, orientation, rng, seed)
    if measurement is not None and measurement.ball is not None:
        path = rollout(measurement.ball, scenario.believed, StopRule.at_x(UNTIL_X))
        goal = scenario.goal or answer(measurement.ball.spin, GoalParams())
        candidates = intercept(path, goal, scenario.believed, scenario.intercept)
        strokes_due = measurement.ball.time + scenario.latency

    model = ArmModel.pa10()
    control = ArmControl(model)
    control.enable(True)
    hardware = Hardware(scenario.truth, Plant(model, scenario.plant), Joints(-scenario.tick, model.waiting, np.zeros(7)), scenario.tick)
    hardware.launch(ball)
    command, record = np.zeros(7), []
    while hardware.joints.time < LONGEST:
        tick = hardware.advance(command)
        now = tick.joints.time
        record.append([now, *tick.joints.q, *tick.joints.qdot])
        if tick.over:
            break
        command = control.step(hardware.plant.measured(tick.joints, rng)).command
        if candidates is not None and now >= strokes_due:
            choice, strokes_due = control.take([s.racket for s in candidates.strokes if s.racket]), np.inf
    return Episode(hardware.outcome or Outcome(ball), goal, measurement, path, candidates, choice, np.array(record))


def landing_error(episode: Episode) -> float | None:
    """m, from the asked landing place to the reached one; None when the ball did not come to the table."""
    landing, goal = episode.outcome.landing, episode.goal
    if landing is None or goal is None or landing.surface != "table":
        return None
    return float(np.hypot(*(landing.before.position[:2] - goal.landing)))


def spin_error(episode: Episode, physics: Physics) -> float | None:
    """rad/s, of the measured spin vector against the true one at the same instant; None without a measurement."""
    if episode.measurement is None or episode.measurement.ball is None:
        return None
    launched, ball = episode.outcome.launched, episode.measurement.ball
    return float(np.linalg.norm(fly(launched.vector, ball.time - launched.time, physics.air.coefficients)[6:] - ball.spin))
