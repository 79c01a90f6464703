"""Transforms from a URDF and joint states, as robot_state_publisher makes them."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation
from tt_core.errors import TtError
from tt_core.states import Array


class UrdfUnreadable(TtError):
    """A text that is no URDF."""


@dataclass(frozen=True)
class Transform:
    """Where a frame is in its parent: p_parent = rotation p_child + translation."""

    parent: str
    child: str
    rotation: Array  # (3, 3)
    translation: Array  # (3,), m


@dataclass(frozen=True)
class _Joint:
    """A joint of a URDF. rest: at zero; axis: (3,), in the frame of the joint."""

    name: str
    kind: str
    rest: Transform
    axis: Array

    def at(self, position: float) -> Transform:
        """Return the transform at a joint position, rad or m."""
        if self.kind == "prismatic":
            moved = self.rest.translation + self.rest.rotation @ (position * self.axis)
            return Transform(self.rest.parent, self.rest.child, self.rest.rotation, moved)
        turn = Rotation.from_rotvec(position * self.axis).as_matrix()
        return Transform(self.rest.parent, self.rest.child, self.rest.rotation @ turn, self.rest.translation)


class Frames:
    """The frames of a robot.

    Attributes:
        fixed: Transforms that never change.
    """

    def __init__(self, urdf: str) -> None:
        """Read a URDF. Raises UrdfUnreadable."""
        try:
            joints = [_joint(element) for element in ET.fromstring(urdf).iter("joint") if element.find("parent") is not None]
        except (ET.ParseError, ValueError, KeyError, AttributeError) as error:
            raise UrdfUnreadable(f"the URDF cannot be read: {error!r}") from error
        self.fixed = [joint.rest for joint in joints if joint.kind == "fixed"]
        self._moving = {joint.name: joint for joint in joints if joint.kind != "fixed"}

    def at(self, positions: Mapping[str, float]) -> list[Transform]:
        """Return the transforms of the moving joints whose positions, rad or m, are given by name."""
        return [self._moving[name].at(position) for name, position in positions.items() if name in self._moving]


def _joint(element: ET.Element) -> _Joint:
    origin, axis = element.find("origin"), element.find("axis")
    place = np.array((origin.get("xyz", "0 0 0") if origin is not None else "0 0 0").split(), float)
    angles = np.array((origin.get("rpy", "0 0 0") if origin is not None else "0 0 0").split(), float)
    ends = [str(element.find(end).attrib["link"]) for end in ("parent", "child")]  # type: ignore[union-attr]
    direction = np.array((axis.get("xyz", "1 0 0") if axis is not None else "1 0 0").split(), float)
    rest = Transform(ends[0], ends[1], Rotation.from_euler("xyz", angles).as_matrix(), place)
    return _Joint(element.attrib["name"], element.attrib["type"], rest, direction / np.linalg.norm(direction))
