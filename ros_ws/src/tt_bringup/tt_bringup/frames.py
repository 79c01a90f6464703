"""Compute the transforms of a robot's frames from its URDF and its joint positions, as robot_state_publisher does."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation
from tt_core.errors import TtError
from tt_core.states import Array


class UrdfUnreadable(TtError):
    """Error: a text cannot be read as a URDF."""


@dataclass(frozen=True)
class Transform:
    """Pose of a frame in its parent frame: p_parent = rotation p_child + translation.

    Attributes:
        parent: Name of the parent frame.
        child: Name of the frame.
        rotation: (3, 3) rotation matrix, child to parent.
        translation: (3,) m, origin of the child in the parent frame.
    """

    parent: str
    child: str
    rotation: Array
    translation: Array


@dataclass(frozen=True)
class _Joint:
    """A joint of a URDF. rest: its transform at joint position 0; axis: (3,) unit vector in the frame of the joint."""

    name: str
    kind: str
    rest: Transform
    axis: Array

    def at(self, position: float) -> Transform:
        """Return the transform at a joint position (rad or m)."""
        if self.kind == "prismatic":
            moved = self.rest.translation + self.rest.rotation @ (position * self.axis)
            return Transform(self.rest.parent, self.rest.child, self.rest.rotation, moved)
        turn = Rotation.from_rotvec(position * self.axis).as_matrix()
        return Transform(self.rest.parent, self.rest.child, self.rest.rotation @ turn, self.rest.translation)


class RobotFrames:
    """The frames of a robot, one for each joint of its URDF.

    Attributes:
        fixed: Transforms of the fixed joints, which never change.
    """

    def __init__(self, urdf: str) -> None:
        """Read the text of a URDF. Raises UrdfUnreadable if it cannot be read."""
        try:
            joints = [_joint(element) for element in ET.fromstring(urdf).iter("joint") if element.find("parent") is not None]
        except (ET.ParseError, ValueError, KeyError, AttributeError) as error:
            raise UrdfUnreadable(f"the URDF cannot be read: {error!r}") from error
        self.fixed = [joint.rest for joint in joints if joint.kind == "fixed"]
        self._moving = {joint.name: joint for joint in joints if joint.kind != "fixed"}

    def at(self, positions: Mapping[str, float]) -> list[Transform]:
        """Return the transforms of the moving joints at given positions.

        Args:
            positions: Position of each joint by its name, rad or m. Names that the URDF does not have are ignored.
        """
        return [self._moving[name].at(position) for name, position in positions.items() if name in self._moving]


def _joint(element: ET.Element) -> _Joint:
    origin, axis = element.find("origin"), element.find("axis")
    place = np.array((origin.get("xyz", "0 0 0") if origin is not None else "0 0 0").split(), float)
    angles = np.array((origin.get("rpy", "0 0 0") if origin is not None else "0 0 0").split(), float)
    parent, child = (str(element.find(end).attrib["link"]) for end in ("parent", "child"))  # type: ignore[union-attr]
    direction = np.array((axis.get("xyz", "1 0 0") if axis is not None else "1 0 0").split(), float)
    rest = Transform(parent, child, Rotation.from_euler("xyz", angles).as_matrix(), place)
    return _Joint(element.attrib["name"], element.attrib["type"], rest, direction / np.linalg.norm(direction))
