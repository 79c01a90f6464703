"""Scenarios, read from YAML: the world, which is the truth, the robot with its models and methods, and the shots.

Each of the three has a file of its own. A scenario names its world and robot: files of `worlds/` and `robots/`, or paths relative to the
scenario's file. Unknown keys are refused, and an error names file and path: `fast.yaml: launcher.rate: -3 is outside [26, 94]`.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from tt_core.errors import TtError, check_choice, check_range
from tt_core.physics import Physics
from tt_core.robots import DEFAULT_ROBOT, ArmFile, arm_file, read_arm, robots
from tt_core.states import BallState, ReturnGoal
from tt_core.strict_yaml import BadFile, build, find_file, not_in_file, read_yaml, yaml_names
from tt_racket.goal import GoalParams
from tt_racket.intercept import InterceptParams
from tt_sim.world.launcher import MIXED, SHOT_KINDS, LauncherParams, shot_row
from tt_sim.world_file import WORLDS, WorldParams

from .sensor_error_model import FASTEST_BALL

SESSION = 25  # balls of a session at a rate, 16 s at the highest rate
HOME = Path(__file__).parent


@dataclass(frozen=True)
class Robot:
    """The models of the robot and its methods.

    Attributes:
        physics: Models of air, table and rubber that the robot assumes.
        stroke: Method of `tt_racket` to find strokes: "exact", or the baselines "sam" (simple model of the flight) and "specular".
        reach: Method of `tt_arm.reach` to find postures: "best" or "liu".
        spin: "measured", or "ignored": the robot takes the spin as zero.
        latency: s, from the middle of the last frame's exposure to the arrival of the strokes at the arm.
        feedback: Whether the wide cameras track the ball, and strokes and swing are corrected until shortly before the strike.
        reaction: s, from the pixels of a pair of wide frames to the arrival of the strokes at the arm.
        interval: s, least time between two states of the tracked ball for which strokes are found.
        patience: s after the first state of a ball, during which the robot waits for a measured one. It is shorter than the node's, because
            the measured ball is never late here.
        learning: Whether flights and returns change the robot's models of air, table and rubber for the next balls of a session; needs
            feedback.
        margin: Share of the joint speeds that a new posture keeps for corrections.
        intercept: Region in which strokes are searched for; None: the hit window of the arm, with its racket speed.
        default_goal: Goal of returns if the scenario has none.
    """

    physics: Physics = field(default_factory=Physics.liu)
    stroke: str = "exact"
    reach: str = "best"
    spin: str = "measured"
    latency: float = 0.06
    feedback: bool = False
    reaction: float = 0.01
    interval: float = 0.03
    patience: float = 0.08
    learning: bool = False
    margin: float = 0.0
    intercept: InterceptParams | None = None
    default_goal: GoalParams = field(default_factory=GoalParams)

    def __post_init__(self) -> None:
        """Refuse values outside their range, and methods that there are not."""
        check_range("latency", self.latency, 0.0, 2.0)
        check_range("reaction", self.reaction, 0.0, 2.0)
        check_range("interval", self.interval, 0.0, 1.0)
        check_range("patience", self.patience, 0.0, 10.0)
        check_range("margin", self.margin, 0.0, 0.9)
        if self.learning and not self.feedback:
            raise TtError("learning = true takes feedback = true")
        check_choice("stroke", self.stroke, ("exact", "sam", "specular"))
        check_choice("reach", self.reach, ("best", "liu"))
        check_choice("spin", self.spin, ("measured", "ignored"))


@dataclass(frozen=True)
class Scenario:
    """A scenario: all that determines a simulation except its random numbers.

    Attributes:
        kind: Kind of the shots: one of the launcher's SHOT_KINDS, or "mixed": all in turn.
        scale: Scale of the shots, one or several in turn.
        shots: "catapult": from the launcher; "rallies": drawn from real play; "given": `ball` each time; "rotation": held by the rotation
            machine.
        ball: The ball at its launch, for "given" shots.
        goal: Goal of the returns; None: that of `tt_racket.goal` for the measured spin.
        world: What is true.
        robot: The robot's models and methods.
        arm: Name of an arm, or path of an arm file or its folder, see docs/arms.md.
        launcher: Place, rate and scatter of the launcher.
        session: Number of balls in a session, whose coefficients scatter about those of the session. None: SESSION if the launcher has a
            rate, otherwise each ball is a session of its own. At a rate one arm returns all balls of a session; without a rate it waits for
            each.
        images: Whether images are rendered and measured. Otherwise the sensor error model gives the measured ball.
        tick: s, between two joint states.
        name: Name of the file, for tables.
    """

    kind: str = MIXED
    scale: int | tuple[int, ...] = (3, 4, 5)
    shots: str = "catapult"
    ball: BallState | None = None
    goal: ReturnGoal | None = None
    world: WorldParams = field(default_factory=WorldParams)
    robot: Robot = field(default_factory=Robot)
    arm: str = DEFAULT_ROBOT
    launcher: LauncherParams = field(default_factory=LauncherParams)
    session: int | None = None
    images: bool = True
    tick: float = 0.002
    name: str = field(default="", metadata=not_in_file())

    def __post_init__(self) -> None:
        """Refuse what cannot be played."""
        check_range("tick", self.tick, 5e-4, 0.02)
        check_choice("sensor_error_model", self.world.sensor_error_model, tuple(yaml_names(HOME / "sensor_error_models")))
        check_choice("kind", self.kind, (*SHOT_KINDS, MIXED))
        check_choice("shots", self.shots, ("catapult", "rallies", "given", "rotation"))
        if not self.scales:
            raise TtError("scale = () is empty")
        for scale in self.scales:
            shot_row("top", scale, self.launcher.z)
        if (self.shots == "given") != (self.ball is not None):
            raise TtError(f"ball goes with shots 'given', not with {self.shots!r}" if self.ball else "ball is missing")
        if self.ball is not None and not self.images:
            check_range("speed of the ball without images", float(np.linalg.norm(self.ball.velocity)), 0.0, FASTEST_BALL)
        if self.launcher.rate and self.shots == "rotation":
            raise TtError(f"launcher.rate = {self.launcher.rate:g} goes with balls that fly, not with shots 'rotation'")
        if self.session is not None:
            check_range("session", self.session, 2, 1000)

    @property
    def scales(self) -> tuple[int, ...]:
        """The scales of the launcher's shots, which are played in turn."""
        return self.scale if isinstance(self.scale, tuple) else (self.scale,)

    @property
    def arm_file(self) -> ArmFile:
        """Content of the arm file.

        Raises:
            BadFile: The file cannot be read, or a value in it is wrong.
        """
        return _arm_file(self.arm)

    @property
    def intercept(self) -> InterceptParams:
        """Region in which the robot searches for strokes, with the racket's speed limit.

        Raises:
            BadFile: The arm file cannot be read, or a value in it is wrong.
        """
        return self.robot.intercept or InterceptParams.of(self.arm_file.hit_window, self.arm_file.racket_speed)

    @property
    def balls(self) -> int:
        """Number of balls in a session."""
        return self.session or (SESSION if self.launcher.rate else 1)

    @property
    def is_played_whole(self) -> bool:
        """Whether balls must be played together, in order: with a launch rate or with learning a ball depends on earlier ones."""
        return bool(self.launcher.rate or (self.robot.learning and self.balls > 1))

    def shot(self, seed: int) -> tuple[str, int]:
        """Return kind and scale of the launcher's shot for a ball. All are played in turn, equally often.

        Args:
            seed: Number of the ball.
        """
        kind = SHOT_KINDS[seed % len(SHOT_KINDS)] if self.kind == MIXED else self.kind
        return kind, self.scales[seed // len(SHOT_KINDS) % len(self.scales)]


@functools.cache
def _arm_file(arm: str) -> ArmFile:
    return read_arm(arm)[0]


def _is_arm(name: str) -> bool:
    """Return whether a name or path is that of an arm, and not of models and methods."""
    if name in yaml_names(HOME / "robots"):
        return False
    try:
        path = arm_file(name)
    except BadFile:
        return False
    return name in robots() or Path(name).is_dir() or "urdf" in read_yaml(path)


def load(name: str, robot: str | None = None, world: str | None = None, images: bool | None = None) -> Scenario:
    """Read a scenario.

    Args:
        name: Name of a file in `scenarios/`, without suffix, or the path of another one.
        robot: Name or path of models and methods, instead of the scenario's; or of an arm, which then plays with those of the scenario.
        world: Name or path of the world, instead of the scenario's.
        images: Whether images are rendered, instead of the scenario's choice.

    Raises:
        BadFile: A file cannot be read, or a value in it is wrong.
    """
    file = find_file(name, HOME / "scenarios")
    content = read_yaml(file)
    key_of_robot = "arm" if robot is not None and _is_arm(robot) else "robot"
    for key, other in ((key_of_robot, robot), ("world", world), ("images", images)):
        if other is not None:
            content[key] = other
    arm = content.get("arm")
    if isinstance(arm, str) and arm not in robots() and not Path(arm).exists() and (file.parent / arm).exists():
        content["arm"] = str(file.parent / arm)
    for key, kind, folder in (("world", WorldParams, WORLDS), ("robot", Robot, HOME / "robots")):
        part = content.get(key)
        if isinstance(part, str):
            there = find_file(part, folder, file.parent)
            content[key] = build(kind, read_yaml(there), there.name)
    return replace(build(Scenario, content, file.name), name=Path(name).stem + (f", robot {robot}" if robot else ""))
