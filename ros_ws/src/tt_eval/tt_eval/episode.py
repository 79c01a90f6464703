"""Simulation of balls from launch to landing without ROS: the same functions as in the nodes, in the same order, deterministic by seed.

With images the ball is measured from them; without, the sensor error model gives the measured ball. `fast_swing` simulates a swing in one
call. If the guard or a torque limit would act, the ticks, steps of fixed duration, are simulated one by one. If balls are launched at a
rate, one arm plays a session of balls in ticks; after each ball it starts from where it is then.

A stroke is position, orientation and velocity of the racket at one time, which return the ball; a swing is the joint motion that makes a
stroke; a path is the predicted flight of the ball.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation
from tt_arm.arm_file import load_arm
from tt_arm.control import ArmControl
from tt_arm.joints import Joints
from tt_arm.kinematics import forward
from tt_arm.model import ArmModel
from tt_arm.reach import ReachFailure
from tt_arm.stroke_selection import SelectionParams, StrokeSelection
from tt_arm.swing import Swing, SwingFailure, SwingLimits
from tt_arm.swing import plan as plan_swing
from tt_core.arrays import VZ, Array, Y, Z
from tt_core.constants import TABLE_WIDTH
from tt_core.failures import Failure
from tt_core.flight import fly
from tt_core.hit_windows import path_end
from tt_core.physics import Physics
from tt_core.states import BallPath, BallState, RacketState, ReturnGoal
from tt_predict.learning import PhysicsLearner
from tt_predict.rollout import StopRule, rollout
from tt_racket.baselines import specular
from tt_racket.failures import StrokeFailure
from tt_racket.goal import default_goal
from tt_racket.intercept import Candidates, InterceptParams, hit_points, intercept
from tt_racket.stroke import Stroke, solve
from tt_sim.cameras.camera_faults import arrivals
from tt_sim.cameras.camera_sequence import camera_sequence
from tt_sim.cameras.tracking_cameras import Sightings, TrackingCameraFaults, TrackingCameraPair, TrackingCameras
from tt_sim.render import Lamps, Scene, Texture
from tt_sim.simulated_robot import SimulatedRobot, Tick
from tt_sim.world import rotation_machine
from tt_sim.world.launcher import launch
from tt_sim.world.outcome import Outcome, Result
from tt_sim.world.plant import Plant
from tt_sim.world.true_ball import Surface
from tt_sim.world_file import WorldParams
from tt_vision.camera import Camera
from tt_vision.capture.assembler import Assembler
from tt_vision.measure import Measurement, measure_burst
from tt_vision.rig import VIEW_CENTRE, WIDE_RATE, high_speed_pair

from . import rallies
from .arm_loop import arm_ticks
from .failures import Causes, EpisodeFailure
from .fast_swing import Setup, rally
from .feedback import BallResponse, Follower
from .miss import OF_RESULT, Miss
from .scenario import Robot, Scenario
from .sensor_error_model import SensorErrorModel, last_frame
from .video_scoring import score_from_video

EPISODE_TIME = 4.0  # s, simulated, after which a ball is given up
TEXTURES = 20  # balls that are marked differently


@dataclass(frozen=True, eq=False)
class Trial:
    """One ball of a scenario: all that is drawn at random before the simulation.

    Attributes:
        scenario: The scenario.
        seed: Number of the ball.
        kind: Kind of the launcher's shot, or the scenario's `shots`.
        scale: Scale of the launcher's shot, or 0.
        ball: The ball at its launch.
        orientation: (3, 3) from the ball's frame to `table` at the launch.
        physics: True physics of this ball.
        cameras: The high-speed cameras; the robot knows their poses exactly.
        lamps: The light. Cameras that follow the opponent's shots carry the lamps with them.
        rng: Random numbers for all that is drawn later.
    """

    scenario: Scenario
    seed: int
    kind: str
    scale: int
    ball: BallState
    orientation: Array
    physics: Physics
    cameras: tuple[Camera, ...]
    lamps: Lamps
    rng: np.random.Generator

    @classmethod
    def drawn(cls, scenario: Scenario, seed: int, time: float = 0.0) -> Trial:
        """Draw a ball at random.

        Args:
            scenario: The scenario.
            seed: Number of the ball.
            time: s, time of the launch.

        Raises:
            NoShots: The scenario wants shots of real play, and there are none.
        """
        rng, lamps = np.random.default_rng(seed), Lamps()
        cameras: tuple[Camera, ...] = _cameras()
        kind, scale = scenario.shot(seed)
        if scenario.shots == "catapult":
            ball, orientation = launch(kind, scale, scenario.launcher, rng)
        else:
            if scenario.shots == "rotation":
                ball = rotation_machine.rotating_ball(seed)
            else:
                known = rallies.reachable_shots(scenario.intercept) if scenario.ball is None else (scenario.ball,)
                ball = known[rng.integers(len(known))]
            kind, scale, orientation = scenario.shots, 0, Rotation.random(rng=rng).as_matrix()
            cameras, lamps = _aimed(ball)
        world = _session_world(scenario.world, seed // scenario.balls)
        physics = world.domain_randomization.draw(world.physics, rng)
        if scenario.shots == "rotation":
            physics = replace(physics, air=rotation_machine.NO_AIR_OR_GRAVITY)
        ball = BallState.from_vector(ball.time + time, ball.vector)
        return cls(scenario, seed, kind, scale, ball, orientation, physics, cameras, lamps, rng)

    def seen(self) -> tuple[Measurement | None, BallState | None]:
        """Render and measure the ball.

        Returns:
            The measurement, or None if the cameras did not see enough of the ball; and the measured ball, or None if the measurement
            failed.
        """
        scene, assembler = Scene(texture=_texture(self.seed % TEXTURES), lamps=self.lamps), Assembler()
        frames = camera_sequence(self.ball, self.orientation, self.cameras, scene, self.physics, self.rng)
        for side, stamp, image in arrivals(frames, self.scenario.world.cameras, self.rng):
            burst = assembler.add(side, stamp, image)
            if burst is not None:
                measurement = measure_burst(burst.seen_by(self.cameras), air=self.scenario.robot.physics.air)
                return measurement, measurement.ball
        return None, None

    def guessed(self) -> BallState | None:
        """Return the ball as it would be measured according to the sensor error model of the world; None if it would not be measured."""
        world, time = self.scenario.world, last_frame(self.ball, self.cameras, self.physics, lamps=self.lamps)
        model = SensorErrorModel.load(world.sensor_error_model)
        if time is None or self.rng.uniform() < model.refused:
            return None
        true = fly(self.ball.vector, time - self.ball.time, self.physics.air.coefficients)
        return model.measured(BallState.from_vector(time + world.cameras.clock_offset, true), self.rng)


@dataclass(frozen=True, eq=False)
class Episode:
    """All that happened to one ball, stage by stage. Attributes are None for stages that were not reached.

    Attributes:
        trial: The ball, and what was drawn before.
        outcome: True result of the ball.
        goal: Landing place, flight time and spin that the return was to have.
        measurement: Measurement from rendered images.
        measured: The ball as the robot has measured it.
        path: Its flight as the robot has predicted it.
        candidates: Strokes that the robot has found.
        selection: The stroke and swing that the arm has selected.
        joints: (n, 1 + 2 joints) time (s), positions (rad or m) and speeds (rad/s or m/s) of each tick; at a rate, from the ball's launch
            on.
        responses: States of the ball until the strike, with the path and strokes that followed from each; empty without feedback.
    """

    trial: Trial
    outcome: Outcome
    goal: ReturnGoal | None
    measurement: Measurement | None
    measured: BallState | None
    path: BallPath | None
    candidates: Candidates | None
    selection: StrokeSelection | None
    joints: Array
    responses: tuple[BallResponse, ...] = ()

    @functools.cached_property
    def sightings(self) -> Sightings:
        """Pixels at which the two wide cameras saw the ball."""
        trial = self.trial
        return Sightings.of(
            self.outcome, trial.physics.air.coefficients, trial.scenario.world.tracking_cameras, np.random.default_rng([trial.seed, 1])
        )

    @functools.cached_property
    def judged(self) -> Outcome:
        """Result of the ball according to these cameras alone.

        The evaluation knows the mean coefficients of the air in this world, but not those of this ball.
        """
        return score_from_video(self.sightings, self.trial.scenario.world.physics.air.coefficients)

    @property
    def reason(self) -> Failure | None:
        """Why the ball was not returned, according to the first stage that failed; None if it landed on the opponent's half."""
        if self.outcome.result is Result.RETURNED:
            return None
        if self.measured is None and not self.responses:
            refused = self.measurement.reason if self.measurement else None
            return Failure(EpisodeFailure.MEASUREMENT_REFUSED, cause=refused) if refused else Failure(EpisodeFailure.NOT_SEEN)
        if self.candidates is None or not self.candidates.strokes:
            causes = [failure for _, failure in self.candidates.refused] if self.candidates else []
            return Failure(EpisodeFailure.NO_STROKE, causes=Causes(causes or [Failure(StrokeFailure.NO_HIT_POINT)]))
        if self.selection is None or self.selection.index is None:
            refusals = self.selection.reasons if self.selection else ()
            return Failure(EpisodeFailure.NO_SWING, cause=refusals[0]) if refusals else Failure(EpisodeFailure.NOT_TRIED)
        return Failure(EpisodeFailure.NOT_RETURNED, result=self.outcome.result)

    @property
    def miss(self) -> Miss | None:
        """Kind of the failure to return the ball; None if it was returned."""
        return self._miss(self.outcome)

    @property
    def judged_miss(self) -> Miss | None:
        """Kind of the failure to return the ball according to the wide cameras and to the robot's reports; None if it was returned."""
        return self._miss(self.judged)

    def _miss(self, outcome: Outcome) -> Miss | None:
        """Return the kind of failure of this episode if the ball had the given result."""
        if outcome.result is Result.RETURNED:
            return None
        if self.measured is None and not self.responses:
            return Miss.REFUSED_SPIN if self.measurement and self.measurement.spin else Miss.NOT_SEEN
        if self.candidates is None or not self.candidates.strokes:
            codes = [failure.code for _, failure in self.candidates.refused] if self.candidates else []
            return Miss.RACKET_TOO_SLOW if 2 * codes.count(StrokeFailure.RACKET_TOO_FAST) > len(codes) else Miss.OUT_OF_REACH
        if self.selection is None or self.selection.index is None:
            refused = {refusal.failure.code for refusal in self.selection.reasons} if self.selection else set()
            if not refused or SwingFailure.TOO_SOON in refused:
                return Miss.TOO_LATE
            return Miss.RACKET_TOO_SLOW if refused & ARM_TOO_SLOW else Miss.OUT_OF_REACH
        return self._beyond(outcome) if outcome.result is Result.OFF_TABLE else OF_RESULT[outcome.result]

    def _beyond(self, outcome: Outcome) -> Miss:
        """Return LONG or WIDE, depending on where a ball that flew past the table fell to the table's height."""
        landing = outcome.landing
        if landing is None:
            return Miss.LONG
        row, air = landing.before.vector, self.trial.physics.air.coefficients
        while row[Z] < self.trial.physics.contact_height and row[VZ] < 0.0:
            row = fly(row, -0.002, air)
        return Miss.LONG if 0.0 <= row[Y] <= TABLE_WIDTH else Miss.WIDE


ARM_TOO_SLOW = {ReachFailure.BEYOND_SPEED_LIMIT, SwingFailure.TORQUE_LIMIT}


@functools.lru_cache(maxsize=4)
def _wide_cameras(faults: TrackingCameraFaults, number: int) -> TrackingCameraPair:
    """Return the wide cameras as they stand in a session."""
    return TrackingCameraPair(faults, np.random.default_rng([number, 5]))


@functools.lru_cache(maxsize=4)
def _session_world(world: WorldParams, number: int) -> WorldParams:
    return world.of_session(number)


@functools.cache
def _cameras() -> tuple[Camera, Camera]:
    return high_speed_pair()


@functools.cache
def _texture(seed: int) -> Texture:
    return Texture.drawn(seed)


@functools.cache
def _arm(name: str) -> ArmModel:
    return load_arm(name)


@functools.cache
def _rest(model: ArmModel) -> Swing:
    """Return what the arm follows while it waits, from 0 s on."""
    return plan_swing(model, Joints.at_rest(0.0, model.waiting), None, 0.0)


def _aimed(ball: BallState) -> tuple[tuple[Camera, ...], Lamps]:
    """Return cameras and lamps moved to where the ball is after the first frames, as if they followed the opponent's racket."""
    shift, light = ball.position + 0.008 * ball.velocity - VIEW_CENTRE, Lamps()
    cameras = (replace(camera, translation=camera.translation - camera.rotation @ shift) for camera in _cameras())
    lamps = (replace(lamp, position=tuple((np.array(lamp.position) + shift).tolist())) for lamp in light.lamps)
    return tuple(cameras), replace(light, lamps=tuple(lamps))


def candidates_for(path: BallPath, goal: ReturnGoal, robot: Robot, params: InterceptParams) -> Candidates:
    """Find the strokes for a path by the robot's method.

    The method is that of `tt_racket.intercept`, or a baseline's at the same points of the path; the baseline's strokes with slow rackets
    come first.

    Args:
        path: Predicted flight of the ball.
        goal: Landing place, flight time and spin of the return.
        robot: Models and methods.
        params: Region in which strokes are searched for.

    Returns:
        The strokes, best first, and why other points have none.
    """
    if robot.stroke == "exact":
        return intercept(path, goal, robot.physics, params)
    found, refused = list[Stroke](), list[tuple[BallState, Failure]]()
    for ball in hit_points(path, params):
        if robot.stroke == "sam":
            stroke = solve(ball, goal, robot.physics, method="sam", racket_speed=params.racket_speed)
        else:
            stroke = specular(ball, goal, robot.physics)
        bound = params.racket_speed
        if stroke.reason is not None:
            refused.append((ball, stroke.reason))
        elif stroke.racket is not None and (speed := float(np.linalg.norm(stroke.racket.velocity))) > bound:
            refused.append((ball, Failure(StrokeFailure.RACKET_TOO_FAST, speed=speed, bound=bound)))
        else:
            found.append(stroke)
    found.sort(key=lambda stroke: float(np.linalg.norm(stroke.racket.velocity)) if stroke.racket else 0.0)
    return Candidates(tuple(found), tuple(refused))


@dataclass(frozen=True, eq=False)
class Plan:
    """What the robot plans for a ball before the arm plans its swing. The other fields are those of Episode.

    Attributes:
        due: s, when the strokes arrive at the arm, or with feedback could arrive; inf for a ball that was not measured.
    """

    measurement: Measurement | None = None
    measured: BallState | None = None
    goal: ReturnGoal | None = None
    path: BallPath | None = None
    candidates: Candidates | None = None
    due: float = np.inf

    @classmethod
    def of(cls, trial: Trial) -> Plan:
        """Measure a ball, predict its flight and find strokes. With feedback the ball is only measured."""
        scenario, robot, cameras = trial.scenario, trial.scenario.robot, trial.scenario.world.cameras
        measurement, measured = trial.seen() if scenario.images else (None, trial.guessed())
        if measured is None:
            return cls(measurement)
        due = measured.time - cameras.clock_offset + cameras.latency + robot.latency
        if robot.feedback:
            return cls(measurement, measured, due=due)
        believed = measured if robot.spin == "measured" else BallState(measured.time, measured.position, measured.velocity, np.zeros(3))
        path = rollout(believed, robot.physics, StopRule.at_x(path_end(scenario.intercept.x_low)))
        goal = scenario.goal or default_goal(measured.spin, robot.default_goal)
        return cls(measurement, measured, goal, path, candidates_for(path, goal, robot, scenario.intercept), due)

    @property
    def rackets(self) -> list[RacketState]:
        """The states of the racket of the strokes, best first."""
        return [stroke.racket for stroke in self.candidates.strokes if stroke.racket] if self.candidates else []


def play(scenario: Scenario, seed: int) -> Episode:
    """Simulate one ball from launch to landing; at a rate, the whole session that it belongs to.

    Args:
        scenario: The scenario.
        seed: Number of the ball. The same seed gives the same episode.

    Raises:
        NoShots: The scenario wants shots of real play, and there are none.
    """
    if scenario.is_played_whole:
        return session(scenario, seed // scenario.balls)[seed % scenario.balls]
    return _alone(Trial.drawn(scenario, seed), PhysicsLearner(scenario.robot.physics))


def session(scenario: Scenario, number: int) -> list[Episode]:
    """Simulate the balls of one session.

    They are launched at the scenario's rate and returned by one arm. Without a rate they are simulated one by one, and the arm waits for
    each. A robot that learns keeps what it has learnt until the session ends.

    Args:
        scenario: The scenario.
        number: Number of the session, from 0.
    """
    first, rate, learner = number * scenario.balls, scenario.launcher.rate, PhysicsLearner(scenario.robot.physics)
    if not rate:
        return [_alone(Trial.drawn(scenario, first + i), learner) for i in range(scenario.balls)]
    trials = [Trial.drawn(scenario, first + i, i * 60.0 / rate) for i in range(scenario.balls)]
    return _tick_by_tick(trials, [Plan.of(trial) for trial in trials], learner, np.random.default_rng([first, 2]))


def _alone(trial: Trial, learner: PhysicsLearner) -> Episode:
    """Play one ball, for which the arm waits."""
    plan = Plan.of(trial)
    if not trial.scenario.robot.feedback:
        done = _swiftly(trial, _control(trial.scenario), _plant(trial.scenario), plan)
        if done is not None:
            return _episode(trial, plan, *done)
    return _tick_by_tick([trial], [plan], learner, trial.rng)[0]


def _control(scenario: Scenario) -> ArmControl:
    limits = SwingLimits(command_timeout=scenario.arm_file.command_timeout)
    selection = SelectionParams(method=scenario.robot.reach, margin=scenario.robot.margin)
    control = ArmControl(_arm(scenario.arm), limits, selection=selection)
    control.enable(True)
    return control


def _plant(scenario: Scenario) -> Plant:
    return Plant(_arm(scenario.arm), scenario.world.plant)


def _episode(
    trial: Trial, plan: Plan, outcome: Outcome, selection: StrokeSelection | None, joints: Array, responses: tuple[BallResponse, ...] = ()
) -> Episode:
    return Episode(trial, outcome, plan.goal, plan.measurement, plan.measured, plan.path, plan.candidates, selection, joints, responses)


Played = tuple[Outcome, "StrokeSelection | None", Array]


def _swiftly(trial: Trial, control: ArmControl, plant: Plant, plan: Plan) -> Played | None:
    """Simulate a ball with its swing in one call; None if the ticks must be simulated one by one."""
    tick, selection, time = trial.scenario.tick, None, 0.0
    if plan.candidates is not None and plan.due < EPISODE_TIME:
        time = tick * np.ceil(plan.due / tick)
        control.joints = Joints.at_rest(time, control.model.waiting)
        control.swing = replace(_rest(control.model), start=control.joints, end_time=time)
        selection = control.take(plan.rackets)
    swing = selection.swing if selection is not None and selection.index is not None else None
    done = rally(trial.ball, swing, time, Setup(trial.physics, plant, control, tick), EPISODE_TIME, trial.rng)
    if done is None:
        return None
    contacts, joints = done
    return Outcome(trial.ball, contacts), selection, joints


def _tick_by_tick(trials: list[Trial], plans: list[Plan], learner: PhysicsLearner, rng: np.random.Generator) -> list[Episode]:
    """Play balls in the order of their launches, until nothing more happens to any.

    Args:
        trials: The balls.
        plans: For each; changed to what the arm has been given last.
        learner: What the robot knows of the coefficients.
        rng: Of the encoders.
    """
    scenario = trials[0].scenario
    control, plant, tick_time = _control(scenario), _plant(scenario), scenario.tick
    robot = SimulatedRobot(trials[0].physics, plant, Joints.at_rest(-tick_time, control.model.waiting), tick_time)
    followed = FollowedSession(trials, plans, learner, control) if scenario.robot.feedback else None
    outcomes, choices, ends = list[Outcome](), dict[int, StrokeSelection](), dict[int, int]()
    record, open_plans = list[list[float]](), sorted(range(len(plans)), key=lambda i: plans[i].due)

    def advance(command: Array) -> Joints:
        """Move arm and balls by one tick, after launching the next ball if it is due."""
        if len(outcomes) < len(trials) and trials[len(outcomes)].ball.time <= robot.joints.time + tick_time:
            outcomes.append(robot.launch(trials[len(outcomes)].ball, trials[len(outcomes)].physics))
            if followed is not None:
                followed.next_ball()
        tick = robot.advance(command)
        if followed is not None:
            followed.see(tick)
        record.append([tick.joints.time, *tick.joints.q, *tick.joints.qdot])
        ends.update({outcomes.index(outcome): len(record) for outcome in tick.ended})
        return tick.joints

    for joints, _ in arm_ticks(control, plant, advance(np.zeros(len(control.model.names))), tick_time, rng, advance):
        if len(ends) == len(trials):
            break
        if followed is not None:
            followed.act(joints.time)
        else:
            while open_plans and plans[open_plans[0]].due <= joints.time:
                i = open_plans.pop(0)
                choices[i] = control.take(plans[i].rackets)
        if joints.time >= trials[-1].ball.time + EPISODE_TIME:
            break
    if followed is not None:
        followed.finish()
        plans, choices = followed.plans, followed.choices
    rows = np.array(record)
    starts = np.searchsorted(rows[:, 0], [trial.ball.time - 0.5 * tick_time for trial in trials])
    return [
        _episode(trial, plan, outcome, choices.get(i), rows[starts[i] : ends.get(i)], followed.responses[i] if followed is not None else ())
        for i, (trial, plan, outcome) in enumerate(zip(trials, plans, outcomes, strict=True))
    ]


class FollowedSession:
    """Wide cameras, tracker and arm of a session, ball after ball; the robot's swings follow the tracked ball.

    Attributes:
        plans: For each ball, the plan for which the arm has made a swing last, or which it was given last.
        choices: The arm's selections for these plans, by number of the ball.
        responses: For each ball the `responses` of its Episode.
    """

    def __init__(self, trials: list[Trial], plans: list[Plan], learner: PhysicsLearner, control: ArmControl) -> None:
        """Start before the first launch.

        Args:
            trials: The balls.
            plans: Plan for each ball.
            learner: Learner of the coefficients of air, table and rubber.
            control: Controller of the arm.
        """
        self._trials, self._learner, self._control = trials, learner, control
        scenario, first = trials[0].scenario, trials[0].seed
        self._latency = scenario.robot.reaction
        pair = _wide_cameras(scenario.world.tracking_cameras, first // scenario.balls)
        rng = np.random.default_rng([first, 4])
        self._cameras = TrackingCameras(pair, scenario.world.physics.air.coefficients, trials[0].ball.time + rng.uniform() / WIDE_RATE, rng)
        self._follower = Follower(scenario, learner)
        self._ball, self._struck = -1, False
        self.plans, self.choices = list(plans), dict[int, StrokeSelection]()
        self.responses = list[tuple[BallResponse, ...]]([()] * len(trials))

    def next_ball(self) -> None:
        """Stop tracking the ball before, and start to track the ball that is launched now."""
        if self._ball >= 0:
            self.finish()
            self._follower = Follower(self._trials[0].scenario, self._learner)
        self._ball, self._struck = self._ball + 1, False
        plan = self.plans[self._ball]
        if plan.measured is not None:
            self._follower.measure(plan.measured, plan.due - self._latency)

    def see(self, tick: Tick) -> None:
        """Add what the wide cameras see during a tick, one step of the simulation."""
        self._follower.see(self._cameras.frames(tick))

    def act(self, now: float) -> None:
        """Give the arm the strokes that are due at time `now` (s), and note the strike when its time has come."""
        response, i = self._follower.response(now), self._ball
        if response is not None and response.rackets:
            selection = self._control.take(response.rackets)
            if selection.swing is not None or i not in self.choices:
                self.choices[i] = selection
                self.plans[i] = replace(self.plans[i], goal=response.goal, path=response.path, candidates=response.candidates)
        elif response is not None and self.plans[i].path is None:
            self.plans[i] = replace(self.plans[i], goal=response.goal, path=response.path, candidates=response.candidates)
        choice, joints = self.choices.get(i), self._control.joints
        if not self._struck and choice is not None and choice.swing is not None and joints is not None and now >= choice.swing.strike_time:
            self._struck = True
            position, rotation, jacobian = forward(joints.q.copy(), self._control.model.chain)
            velocity, turning = np.split(jacobian @ joints.qdot, 2)
            self._follower.strike(RacketState.facing(joints.time, position, velocity, rotation[:, 2]), turning)

    def finish(self) -> None:
        """Learn from the ball that was tracked last, and store its responses."""
        self.responses[self._ball] = tuple(self._follower.responses)
        self._follower.finish()


def landing_error(episode: Episode) -> float | None:
    """Return the horizontal distance (m) of the true landing place from the wanted one; None if the return did not land on the table."""
    landing, goal = episode.outcome.landing, episode.goal
    if landing is None or goal is None or landing.surface is not Surface.TABLE:
        return None
    return float(np.hypot(*(landing.before.position[:2] - goal.landing)))


def truth(episode: Episode, stamp: float) -> Array:
    """Return the true state of the launched ball, while it is in the view of the high-speed cameras.

    Args:
        episode: The ball.
        stamp: s, by the clock of these cameras.

    Returns:
        (9,) position (m), velocity (m/s), spin (rad/s).
    """
    trial, time = episode.trial, stamp - episode.trial.scenario.world.cameras.clock_offset
    return np.asarray(fly(trial.ball.vector, time - trial.ball.time, trial.physics.air.coefficients))


def spin_error(episode: Episode) -> float | None:
    """Return the norm of measured minus true spin at the time of the measurement, rad/s; None without a measurement."""
    if episode.measured is None:
        return None
    return float(np.linalg.norm(truth(episode, episode.measured.time)[6:] - episode.measured.spin))
