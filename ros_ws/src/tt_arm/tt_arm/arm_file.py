"""An arm from its arm file: the parameter `robot` of nodes, the key `arm` of scenarios."""

from __future__ import annotations

from collections.abc import Sequence

from tt_core.robots import read_arm

from .model import ArmModel, UrdfOptions


def load_arm(robot: str, base: Sequence[float] = (), mount: Sequence[float] = (), waiting: Sequence[float] = ()) -> ArmModel:
    """Return the arm of a file.

    Args:
        robot: Name, arm file or folder, see `tt_core.robots.arm_file`; empty for the Mitsubishi PA10.
        base: As of `ArmModel.from_urdf`, instead of that of the file; empty for that.
        mount: The same of the mount.
        waiting: The same of the waiting posture.

    Raises:
        BadFile: The file cannot be read, or something in it is wrong.
        TtError: The arm cannot be made of it, see `ArmModel.from_urdf`.
    """
    given, urdf = read_arm(robot)
    options = UrdfOptions(given.limits, given.fixed, given.left_out)
    return ArmModel.from_urdf(
        urdf,
        given.tip,
        base if len(base) else given.base,
        mount if len(mount) else given.mount,
        waiting if len(waiting) else given.waiting,
        options,
    )
