"""What is played, read from YAML: a world, which is true, a robot, which believes, and the shots. Each is a file of its own.

A scenario names its world and robot, files of `worlds/` and `robots/` here or paths beside it. Nothing is taken that is not known, and an
error names the file and the path in it: `fast.yaml: launcher.rate: -3 is outside [26, 94]`.
"""

from __future__ import annotations

import functools
import types
import typing
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from tt_core.bounce import RacketRebound, TableRebound
from tt_core.constants import BALL_RADIUS
from tt_core.errors import OutOfRange, TtError, check_range
from tt_core.flight import Aerodynamics
from tt_core.physics import Physics
from tt_core.states import BallState, ReturnGoal
from tt_racket.goal import GoalParams
from tt_racket.intercept import InterceptParams

from .faults import CameraFaults
from .launcher import KINDS, MIXED, LauncherParams, row
from .plant import PlantParams
from .sight import FASTEST
from .vary import Variation
from .wide import WideFaults
from .world import LEAST_CONTACT

SESSION = 25  # balls, 16 s at the highest rate
HOME = Path(__file__).parent
MODELS = {
    "liu": Physics.liu(),
    "measured": Physics.measured(),
    "gravity only": Physics(air=Aerodynamics.gravity_only()),
}


class BadScenario(TtError):
    """A scenario that cannot be played: file, path in it, and why."""


@dataclass(frozen=True)
class Truth:
    """The world. vary: by how much its coefficients differ from trial to trial. wide: of the cameras that judge returns. sight: the error
    model of the fast cameras, a file of `sights/`, for scenarios without images."""

    physics: Physics = field(default_factory=Physics.liu)
    vary: Variation = field(default_factory=Variation)
    cameras: CameraFaults = field(default_factory=CameraFaults)
    wide: WideFaults = field(default_factory=WideFaults)
    plant: PlantParams = field(default_factory=PlantParams)
    sight: str = "clear"

    def __post_init__(self) -> None:
        check_range("contact_height", self.physics.contact_height, LEAST_CONTACT, 0.1)
        _one_of("sight", self.sight, tuple(names("sights")))


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
    answer: GoalParams = field(default_factory=GoalParams)

    def __post_init__(self) -> None:
        check_range("latency", self.latency, 0.0, 2.0)
        _one_of("stroke", self.stroke, ("exact", "sam", "specular"))
        _one_of("reach", self.reach, ("best", "liu"))
        _one_of("spin", self.spin, ("measured", "ignored"))


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
    world: Truth = field(default_factory=Truth)
    robot: Robot = field(default_factory=Robot)
    launcher: LauncherParams = field(default_factory=LauncherParams)
    session: int | None = None
    images: bool = True
    tick: float = 0.002
    name: str = ""

    def __post_init__(self) -> None:
        check_range("tick", self.tick, 5e-4, 0.02)
        _one_of("kind", self.kind, (*KINDS, MIXED))
        _one_of("shots", self.shots, ("catapult", "rallies", "given", "rotation"))
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


def _one_of(name: str, value: str, known: tuple[str, ...]) -> None:
    if value not in known:
        raise TtError(f"{name} {value!r} is none of {', '.join(known)}")


def names(folder: str = "scenarios") -> list[str]:
    """Those that come with the package."""
    return sorted(file.stem for file in (HOME / folder).glob("*.yaml"))


def load(name: str, robot: str | None = None, world: str | None = None, images: bool | None = None) -> Scenario:
    """The scenario of that name here, or of that file; robot, world, images: take these instead of its own. Raises BadScenario."""
    file = _find(name, "scenarios", Path())
    content = _read(file)
    for key, other in (("robot", robot), ("world", world), ("images", images)):
        if other is not None:
            content[key] = other
    for key, kind in (("world", Truth), ("robot", Robot)):
        part = content.get(key)
        if isinstance(part, str):
            there = _find(part, f"{key}s", file.parent)
            content[key] = build(kind, _read(there), there.name)
    return replace(build(Scenario, content, file.name), name=Path(name).stem + (f", robot {robot}" if robot else ""))


def load_world(name: str) -> Truth:
    """The world of that name here, or of that file. Raises BadScenario."""
    file = _find(name, "worlds", Path())
    return build(Truth, _read(file), file.name)


def _find(name: str, folder: str, beside: Path) -> Path:
    if name in names(folder):
        return HOME / folder / f"{name}.yaml"
    for path in (Path(name), beside / name):
        if path.suffix == ".yaml" and path.is_file():
            return path
    raise BadScenario(f"{name}: no such file, and none of the {folder} here, {', '.join(names(folder))}")


class _Strict(yaml.SafeLoader):
    """Refuses a key that is given twice, of which YAML's readers take the last."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [key.value for key, _ in node.value]
        twice = next((key for key in keys if keys.count(key) > 1), None)
        if twice is not None:
            raise yaml.constructor.ConstructorError(None, None, f"{twice} is given twice", node.start_mark)
        return super().construct_mapping(node, deep)


def _read(file: Path) -> dict[str, Any]:
    try:
        content = yaml.load(file.read_text(), _Strict)
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise BadScenario(f"{file.name}: {' '.join(str(error).split())}") from error
    if not isinstance(content, dict):
        raise BadScenario(f"{file.name}: {content!r} is not a mapping of keys to values")
    return content


@functools.cache
def _hints(kind: type) -> dict[str, Any]:
    return typing.get_type_hints(kind)


def build(kind: Any, content: Any, file: str, path: str = "", default: Any = None) -> Any:
    """A dataclass from a mapping, strictly; fields that are not there are those of `default`, or the class's own. Raises BadScenario."""

    def refuse(key: str, why: str) -> BadScenario:
        where = ".".join(part for part in (path, key) if part)
        return BadScenario(f"{file}: {where}: {why}" if where else f"{file}: {why}")

    if not isinstance(content, Mapping):
        raise refuse("", f"{content!r} is not a mapping of keys to values")
    known = [f.name for f in fields(kind) if f.name not in ("name", "covariance")]
    values = {name: getattr(default, name) for name in known} if default is not None else {}
    if kind is BallState:
        values["time"] = 0.0
    for key, value in content.items():
        if key not in known:
            raise refuse(str(key), f"unknown, known are {', '.join(known)}")
        below = ".".join(part for part in (path, key) if part)
        values[key] = _value(_hints(kind)[key], value, file, below)
    try:
        return kind(**values)
    except OutOfRange as error:
        raise refuse(error.name, f"{error.value:g} is outside [{error.low:g}, {error.high:g}]") from error
    except (TtError, TypeError) as error:
        raise refuse("", str(error)) from error


def _value(hint: Any, value: Any, file: str, path: str) -> Any:
    """`value` in the type of the field."""
    if isinstance(value, Truth | Robot):
        return value
    if hint is Physics:
        return _physics(value, file, path)
    options = [part for part in typing.get_args(hint) if part is not type(None)] if _is_union(hint) else [hint]
    for option in options:
        if is_dataclass(option):
            return build(option, value, file, path)
        if option in (str, bool) and isinstance(value, option):
            return value
        if option is float and isinstance(value, int | float) and not isinstance(value, bool):
            return float(value)
        if option is int and isinstance(value, int) and not isinstance(value, bool):
            return value
        if typing.get_origin(option) in (tuple, list) and isinstance(value, list):
            part = typing.get_args(option)[0]
            return tuple(_value(part, one, file, f"{path}[{i}]") for i, one in enumerate(value))
        if "ndarray" in str(option) and isinstance(value, list):
            return [_value(float, one, file, f"{path}[{i}]") for i, one in enumerate(value)]
    wanted = " or ".join(getattr(option, "__name__", str(option)) if typing.get_origin(option) is None else "list" for option in options)
    raise BadScenario(f"{file}: {path}: {value!r} is not of type {wanted}")


def _is_union(hint: Any) -> bool:
    return typing.get_origin(hint) in (typing.Union, types.UnionType)


def _physics(content: Any, file: str, path: str) -> Physics:
    """A name of MODELS, or a mapping: the name as `model`, and single coefficients of air, table, racket."""
    content = {"model": content} if isinstance(content, str) else content
    if not isinstance(content, Mapping):
        raise BadScenario(f"{file}: {path}: {content!r} is not a name or a mapping of keys to values")
    parts = {"air": Aerodynamics, "table": TableRebound, "racket": RacketRebound}
    unknown = set(content) - {"model", "contact_height", *parts}
    if unknown:
        raise BadScenario(f"{file}: {path}.{sorted(map(str, unknown))[0]}: unknown, known are model, contact_height, {', '.join(parts)}")
    model = content.get("model", "liu")
    if model not in MODELS:
        raise BadScenario(f"{file}: {path}.model: {model!r} is none of {', '.join(MODELS)}")
    default = MODELS[model]
    given = {
        name: build(kind, content[name], file, f"{path}.{name}", getattr(default, name)) for name, kind in parts.items() if name in content
    }
    height = _value(float, content.get("contact_height", BALL_RADIUS), file, f"{path}.contact_height")
    try:
        return replace(default, contact_height=height, **given)
    except OutOfRange as error:
        raise BadScenario(f"{file}: {path}.{error.name}: {error.value:g} is outside [{error.low:g}, {error.high:g}]") from error
