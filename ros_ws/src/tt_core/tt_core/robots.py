"""What is known of an arm before its URDF is read: its arm file, found by the name or the path that a parameter `robot` has.

An arm that comes with the workspace is a folder `config/NAME` of tt_bringup with the URDF and the arm file arm.yaml. See docs/arms.md.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory

from .constants import COMMAND_TIMEOUT
from .errors import check_range
from .hit_windows import HIT_WINDOWS, RACKET_SPEED, HitWindow
from .strict_yaml import BadFile, Problem, build, read
from .yaml_errors import Unreadable

DEFAULT = "pa10"  # name of the arm where none is given
ARM_FILE = "arm.yaml"  # in the folder of an arm


@dataclass(frozen=True)
class ArmFile:
    """What a file says of an arm.

    Attributes:
        urdf: Path of the URDF, relative to the file.
        tip: As of `tt_arm.model.ArmModel.from_urdf`.
        base: As of `from_urdf`.
        mount: As of `from_urdf`.
        waiting: As of `from_urdf`.
        limits: As of `tt_arm.model.UrdfOptions`.
        fixed: As of `UrdfOptions`.
        left_out: As of `UrdfOptions`.
        hit_window: Where the arm hits balls.
        racket_speed: m/s, the highest of the strokes that are offered to the arm.
        command_timeout: s, for which its drives hold a command.
    """

    urdf: str
    tip: str | None = None
    base: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    mount: tuple[float, ...] | None = None
    waiting: tuple[float, ...] | None = None
    limits: dict[str, dict[str, float]] = field(default_factory=dict)
    fixed: dict[str, float] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()
    hit_window: HitWindow = HIT_WINDOWS["near"]
    racket_speed: float = RACKET_SPEED
    command_timeout: float = COMMAND_TIMEOUT

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check_range("racket_speed", self.racket_speed, 0.1, 20.0)
        check_range("command_timeout", self.command_timeout, 0.001, 10.0)


def robots() -> dict[str, Path]:
    """Return the folders of the arms that come with the workspace, by name; none where tt_bringup is not installed."""
    try:
        config = Path(get_package_share_directory("tt_bringup")) / "config"
    except (PackageNotFoundError, LookupError):
        return {}
    return {file.parent.name: file.parent for file in sorted(config.glob(f"*/{ARM_FILE}"))}


def arm_file(robot: str) -> Path:
    """Return the path of an arm file.

    Args:
        robot: Name of an arm that comes with the workspace, an arm file, or a folder with an arm file arm.yaml; empty for DEFAULT.

    Raises:
        BadFile: There is none.
    """
    known = robots()
    path = known[robot or DEFAULT] if (robot or DEFAULT) in known else Path(robot)
    path = path / ARM_FILE if path.is_dir() else path
    if not path.is_file() or path.suffix != ".yaml":
        names = ", ".join(known) or "none: tt_bringup is not installed"
        raise BadFile(robot, (Problem("", Unreadable(f"no arm file, no folder with {ARM_FILE}, and none of the robots here, {names}")),))
    return path


def read_arm(robot: str) -> tuple[ArmFile, Path]:
    """Read the arm file of a robot, see `arm_file`.

    Returns:
        What it says, and the path of the URDF.

    Raises:
        BadFile: There is no such file, it cannot be read, or something in it is wrong.
    """
    path = arm_file(robot)
    given = build(ArmFile, read(path), path.name)
    return given, path.parent / given.urdf
