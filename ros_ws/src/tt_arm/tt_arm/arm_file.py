"""An arm from its arm file: the parameter `robot` of nodes, the key `arm` of scenarios."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tt_core.errors import BadShape
from tt_core.params import check, param
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


@dataclass(frozen=True)
class InstalledArm:
    """Which arm it is and how it is mounted, as parameters of a node."""

    robot: str = param("", "", "name of an arm, or path of an arm file or its folder, see docs/arms.md; empty: pa10")
    base: tuple[float, ...] = param(
        (), "m, rad", "root link in `table`: x, y, z and yaw, or x, y, z, roll, pitch and yaw; empty: as the arm file says"
    )
    mount: tuple[float, ...] = param(
        (), "m, rad", "racket on the tip: m along its z axis and rad about its y axis, or six numbers; empty: as the arm file says"
    )
    waiting: tuple[float, ...] = param(
        (), "rad, m", "positions of the joints at which the arm waits for a ball; empty: as the arm file says"
    )
    joints: tuple[str, ...] = param(
        (), "", "names of the joints in joint states, in the order of the commands; empty: the names of the URDF"
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)

    def model(self) -> ArmModel:
        """Return the arm; raises as `load_arm` does."""
        return load_arm(self.robot, self.base, self.mount, self.waiting)

    def joint_names(self, model: ArmModel) -> Sequence[str]:
        """Return the names of the joints in joint states; raises BadShape if they are not as many as those of the model."""
        names = self.joints or model.names
        if len(names) != len(model.names):
            raise BadShape("joints", (len(names),), (len(model.names),))
        return names
