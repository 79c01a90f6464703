"""Load the model of an arm from its arm file, which the parameter `robot` of nodes and the key `arm` of scenarios name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tt_core.errors import BadShape
from tt_core.params import check, param
from tt_core.robots import read_arm

from .model import ArmModel, UrdfOptions


def load_arm(robot: str, base: Sequence[float] = (), mount: Sequence[float] = (), waiting: Sequence[float] = ()) -> ArmModel:
    """Return the model of the arm that an arm file describes.

    Args:
        robot: Name of an arm, or path of an arm file or its folder, see `tt_core.robots.arm_file`; empty for the Mitsubishi PA10.
        base: Pose of the root link in `table`, as in `ArmModel.from_urdf`; empty for that of the file.
        mount: Pose of the racket on the tip, as in `ArmModel.from_urdf`; empty for that of the file.
        waiting: (n,) rad or m, joint positions at which the arm waits for a ball; empty for those of the file.

    Raises:
        BadFile: The file cannot be read, or its content is wrong.
        TtError: The model cannot be made from it, see `ArmModel.from_urdf`.
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
    """Parameters of a node that choose the arm, its mounting, its waiting posture and the names of its joints."""

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
        """Return the model of the arm that the parameters choose; raises the errors of `load_arm`."""
        return load_arm(self.robot, self.base, self.mount, self.waiting)

    def joint_names(self, model: ArmModel) -> Sequence[str]:
        """Return the names that the joints of `model` have in joint states: the parameter `joints`, or else the names of the URDF.

        Raises:
            BadShape: The number of names differs from that of the model's joints.
        """
        names = self.joints or model.names
        if len(names) != len(model.names):
            raise BadShape("joints", (len(names),), (len(model.names),))
        return names
