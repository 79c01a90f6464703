"""What is played, read from YAML: a world, which is true, a robot, which believes, and the shots. Each is a file of its own.

A scenario names its world and robot, files of `worlds/` and `robots/` here or paths beside it. Nothing is taken that is not known, and an
error names the file and the path in it: `fast.yaml: launcher.rate: -3 is outside [26, 94]`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from tt_core.errors import TtError, check_choice, check_range
from tt_core.physics import Physics
from tt_core.states import BallState, ReturnGoal
from tt_core.strict_yaml import build, find, names, not_in_file, read
from tt_racket.goal import GoalParams
from tt_racket.intercept import InterceptParams
from tt_sim.world.launcher import KINDS, MIXED, LauncherParams, row
from tt_sim.world_file import WORLDS, WorldParams

from .sensor_error_model import FASTEST

SESSION = 25  # balls, 16 s at the highest rate
HOME = Path(__file__).parent


@dataclass(frozen=True)
class Robot:
    """What the robot believes and how it answers; the methods are those of tt_racket and tt_arm, named there.

    latency: s, from the middle of the last frame's exposure to the strokes at the arm. spin: "measured", or "ignored": it is taken as none.
    """

    physics: Physics = field(default_factory=Physics.liu)
    stroke: str = "exact"
    reach: str = "best"
    spin: str = "measured"
    latency: float = 0.06
    intercept: InterceptParams = field(default_factory=InterceptParams)
    default_goal: GoalParams = field(default_factory=GoalParams)

    def __post_init__(self) -> None:
        check_range("latency", self.latency, 0.0, 2.0)
        check_choice("stroke", self.stroke, ("exact", "sam", "specular"))
        check_choice("reach", self.reach, ("best", "liu"))
        check_choice("spin", self.spin, ("measured", "ignored"))


@dataclass(frozen=True)
class Scenario:
    """kind: one of KINDS, or "mixed", all in turn. scale: of the catapult, one or several in turn. shots: "catapult", "rallies", drawn from
    real play, "given", the `ball` itself, or "rotation", held by the rotation machine. goal: None answers the measured spin
    (`tt_racket.goal`). session: balls that one arm meets at the launcher's rate, without a rate each ball has an arm that waits for it.
    images: rendered and measured, or the measurement's error model instead. tick: s between two joint states.
    """

    kind: str = MIXED
    scale: int | tuple[int, ...] = (3, 4, 5)
    shots: str = "catapult"
    ball: BallState | None = None
    goal: ReturnGoal | None = None
    world: WorldParams = field(default_factory=WorldParams)
    robot: Robot = field(default_factory=Robot)
    launcher: LauncherParams = field(default_factory=LauncherParams)
    session: int | None = None
    images: bool = True
    tick: float = 0.002
    name: str = field(default="", metadata=not_in_file())

    def __post_init__(self) -> None:
        check_range("tick", self.tick, 5e-4, 0.02)
        check_choice("sensor_error_model", self.world.sensor_error_model, tuple(names(HOME / "sensor_error_models")))
        check_choice("kind", self.kind, (*KINDS, MIXED))
        check_choice("shots", self.shots, ("catapult", "rallies", "given", "rotation"))
        if not self.scales:
            raise TtError("scale = () is empty")
        for scale in self.scales:
            row("top", scale, self.launcher.z)
        if (self.shots == "given") != (self.ball is not None):
            raise TtError(f"ball goes with shots 'given', not with {self.shots!r}" if self.ball else "ball is missing")
        if self.ball is not None and not self.images:
            check_range("speed of the ball without images", float(np.linalg.norm(self.ball.velocity)), 0.0, FASTEST)
        if self.launcher.rate and self.shots == "rotation":
            raise TtError(f"launcher.rate = {self.launcher.rate:g} goes with balls that fly, not with shots 'rotation'")
        if self.session is not None:
            check_range("session", self.session, 2, 1000)
            if not self.launcher.rate:
                raise TtError(f"session = {self.session} goes with a launcher.rate")

    @property
    def scales(self) -> tuple[int, ...]:
        return self.scale if isinstance(self.scale, tuple) else (self.scale,)

    @property
    def balls(self) -> int:
        """Of a session; 1 without a rate."""
        return (self.session or SESSION) if self.launcher.rate else 1

    def shot(self, seed: int) -> tuple[str, int]:
        """Kind and scale of a trial: by turns, so that all are played equally often."""
        kind = KINDS[seed % len(KINDS)] if self.kind == MIXED else self.kind
        return kind, self.scales[seed // len(KINDS) % len(self.scales)]


def load(name: str, robot: str | None = None, world: str | None = None, images: bool | None = None) -> Scenario:
    """The scenario of that name here, or of that file; robot, world, images: take these instead of its own. Raises BadFile."""
    file = find(name, HOME / "scenarios")
    content = read(file)
    for key, other in (("robot", robot), ("world", world), ("images", images)):
        if other is not None:
            content[key] = other
    for key, kind, folder in (("world", WorldParams, WORLDS), ("robot", Robot, HOME / "robots")):
        part = content.get(key)
        if isinstance(part, str):
            there = find(part, folder, file.parent)
            content[key] = build(kind, read(there), there.name)
    return replace(build(Scenario, content, file.name), name=Path(name).stem + (f", robot {robot}" if robot else ""))
