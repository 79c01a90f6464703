"""An arm from a YAML file that names its URDF, and where it stands: the parameter `robot` of nodes, the key `arm` of scenarios."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from tt_core.strict_yaml import build, find, read

from .model import ArmModel, UrdfOptions

NONE = Path(__file__).parent / "robots"  # there are no named files: the PA10 is in the code


@dataclass(frozen=True)
class ArmFile:
    """What a file says of an arm.

    Attributes:
        urdf: Path of the URDF, relative to the file.
        tip: As of `ArmModel.from_urdf`.
        base: As of `ArmModel.from_urdf`.
        mount: As of `ArmModel.from_urdf`.
        waiting: As of `ArmModel.from_urdf`.
        limits: As of `UrdfOptions`.
        fixed: As of `UrdfOptions`.
        left_out: As of `UrdfOptions`.
    """

    urdf: str
    tip: str | None = None
    base: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    mount: tuple[float, ...] | None = None
    waiting: tuple[float, ...] | None = None
    limits: dict[str, dict[str, float]] = field(default_factory=dict)
    fixed: dict[str, float] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()


def load_arm(name: str) -> ArmModel:
    """Return the arm of a file.

    Args:
        name: Path of the file; "pa10" or an empty text for the Mitsubishi PA10 with its usual base, mount and waiting posture.

    Raises:
        BadFile: The file cannot be read, or something in it is wrong.
        TtError: The arm cannot be made of it, see `ArmModel.from_urdf`.
    """
    if name in ("", "pa10"):
        return ArmModel.pa10()
    file = find(name, NONE)
    given = build(ArmFile, read(file), file.name)
    options = UrdfOptions(given.limits, given.fixed, given.left_out)
    return ArmModel.from_urdf(file.parent / given.urdf, given.tip, given.base, given.mount, given.waiting, options)
