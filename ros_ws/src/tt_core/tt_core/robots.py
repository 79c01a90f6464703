"""Arm files: what is known of an arm before its URDF is read. They are found by the name or path in the parameter `robot`.

An arm that comes with the workspace is a folder `config/NAME` of tt_bringup with the URDF and the arm file arm.yaml. See docs/arms.md.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory

from .constants import COMMAND_TIMEOUT
from .errors import check_range
from .hit_windows import HIT_WINDOWS, RACKET_SPEED, HitWindow
from .strict_yaml import BadFile, Problem, build, read_yaml
from .yaml_errors import Unreadable

DEFAULT_ROBOT = "pa10"  # name of the arm where none is given
ARM_FILE = "arm.yaml"  # in the folder of an arm


@dataclass(frozen=True)
class ArmFile:
    """Content of an arm file: which URDF describes the arm, how arm and racket are mounted, and where the arm hits balls.

    Attributes:
        urdf: Path of the URDF, relative to the arm file.
        tip: Link that the racket is mounted on; None for the only link to which nothing is attached.
        base: Pose of the root link in `table`: x, y, z (m) and yaw (rad), or x, y, z and roll, pitch, yaw.
        mount: Pose of the racket on the tip: distance (m) along the tip's z axis and angle (rad) about its y axis, or x, y, z (m) and roll,
            pitch, yaw (rad). None for the pose that the URDF states.
        waiting: (n,) rad or m, joint positions in which the arm waits for a ball; None for the middle of each joint's range.
        limits: Joint limits that replace those of the URDF, by joint and by limit, see `tt_arm.arm_urdf.urdf.UrdfOptions`.
        fixed: Positions (rad or m) of moving joints that are to be fixed, by joint.
        left_out: Names of links of the URDF that are left out, with everything attached to them.
        hit_window: Box in which the arm hits balls.
        racket_speed: m/s, highest racket speed of the strokes that are offered to the arm, 0.1 to 20.
        command_timeout: s, for which the drives hold a command, 0.001 to 10.
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
    """Return the folders of the arms that come with the workspace, by the names of the arms; empty if tt_bringup is not installed."""
    try:
        config = Path(get_package_share_directory("tt_bringup")) / "config"
    except (PackageNotFoundError, LookupError):
        return {}
    return {file.parent.name: file.parent for file in sorted(config.glob(f"*/{ARM_FILE}"))}


def arm_file(robot: str) -> Path:
    """Return the path of an arm file.

    Args:
        robot: Name of an arm that comes with the workspace, or the path of an arm file or of a folder with an arm file arm.yaml. Empty for
            DEFAULT_ROBOT.

    Raises:
        BadFile: There is no such arm file.
    """
    known = robots()
    path = known[robot or DEFAULT_ROBOT] if (robot or DEFAULT_ROBOT) in known else Path(robot)
    path = path / ARM_FILE if path.is_dir() else path
    if not path.is_file() or path.suffix != ".yaml":
        names = ", ".join(known) or "none: tt_bringup is not installed"
        raise BadFile(robot, (Problem("", Unreadable(f"no arm file, no folder with {ARM_FILE}, and none of the robots here, {names}")),))
    return path


def read_arm(robot: str) -> tuple[ArmFile, Path]:
    """Read the arm file of a robot.

    Args:
        robot: Name or path, as for `arm_file`.

    Returns:
        The content of the arm file, and the path of the URDF.

    Raises:
        BadFile: There is no such file, it cannot be read, or a value in it is wrong.
    """
    path = arm_file(robot)
    given = build(ArmFile, read_yaml(path), path.name)
    return given, path.parent / given.urdf
