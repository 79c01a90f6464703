"""The visible shapes of the arm: the visual elements of its URDF, placed by given joint positions."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin
from tt_arm.arm_urdf.urdf import RACKET_LINK
from tt_core.arrays import Array
from tt_core.errors import TtError

from .items import Colour, Item, Shape

GREY: Colour = (0.62, 0.65, 0.7, 1.0)  # colour of a link, if the URDF gives it none
RED: Colour = (0.75, 0.13, 0.12, 1.0)  # colour of the racket, if the URDF gives it none


class RobotShapes:
    """The visible shapes of a robot.

    Attributes:
        name: Name of the robot.
        speed_limits: Speed limit of each moving joint by name, rad/s or m/s.
    """

    def __init__(self, urdf: str) -> None:
        """Read a URDF.

        Args:
            urdf: Text of the URDF. Its root link is placed at the origin of the frame `table`.

        Raises:
            TtError: The text is no URDF, or a visual element has an unknown geometry.
        """
        try:
            self._model = pin.buildModelFromXML(urdf)
            robot = ET.fromstring(urdf)
        except (ValueError, RuntimeError, ET.ParseError) as error:
            raise TtError(f"the robot description cannot be read: {error}") from error
        self._data = self._model.createData()
        self.name: str = self._model.name
        joints = list(zip(self._model.names, self._model.joints, strict=True))[1:]  # the first one is the world
        self._joints = {name: joint for name, joint in joints if joint.nv == 1}
        self.speed_limits = {name: float(self._model.velocityLimit[joint.idx_v]) for name, joint in self._joints.items()}
        self._visuals = [
            (self._model.getFrameId(link.get("name", "")), _visual(robot, link, i, visual))
            for link in robot.findall("link")
            for i, visual in enumerate(link.findall("visual"))
        ]

    def items(self, positions: Mapping[str, float]) -> list[Item]:
        """Return the shapes of the robot at given joint positions, as items in the frame `table`.

        Args:
            positions: Position of each joint by name, rad or m. A joint that is not named is at its neutral position.
        """
        q = pin.neutral(self._model)
        for name, joint in self._joints.items():
            if name in positions:  # a joint without limits is a point on the unit circle
                q[joint.idx_q : joint.idx_q + joint.nq] = positions[name] if joint.nq == 1 else _on_circle(positions[name])
        pin.framesForwardKinematics(self._model, self._data, q)
        return [_placed(item, self._data.oMf[frame]) for frame, item in self._visuals]


def _on_circle(angle: float) -> tuple[float, float]:
    return math.cos(angle), math.sin(angle)


def _placed(item: Item, link: pin.SE3) -> Item:
    """Return an item, given in the frame of its link, in the frame `table`. link: the pose of the link."""
    return replace(item, position=link.translation + link.rotation @ item.position, rotation=link.rotation @ item.rotation)


def _visual(robot: ET.Element, link: ET.Element, index: int, visual: ET.Element) -> Item:
    """Return one visual element of a link as an item in the frame of the link."""
    name = f"arm/{link.get('name')}/{index}"
    origin = visual.find("origin")
    position = _numbers(origin, "xyz", (0.0, 0.0, 0.0))
    rotation = pin.rpy.rpyToMatrix(*_numbers(origin, "rpy", (0.0, 0.0, 0.0)))
    colour = _colour(robot, visual) or (RED if link.get("name") == RACKET_LINK else GREY)
    shape, size, mesh = _geometry(name, visual.find("geometry"))
    return Item(name, shape, colour, size, position, rotation, mesh=mesh)


def _geometry(name: str, geometry: ET.Element | None) -> tuple[Shape, Array, str]:
    """Return shape, size and mesh of a geometry, as the attributes of Item."""
    forms = {} if geometry is None else {form.tag: form for form in geometry}
    if (form := forms.get("box")) is not None:
        return Shape.BOX, _numbers(form, "size", (1.0, 1.0, 1.0)), ""
    if (form := forms.get("cylinder")) is not None or (form := forms.get("capsule")) is not None:
        diameter, length = 2.0 * _number(form, "radius"), _number(form, "length")
        return Shape.CYLINDER, np.array([diameter, diameter, length]), ""
    if (form := forms.get("sphere")) is not None:
        return Shape.ELLIPSOID, np.full(3, 2.0 * _number(form, "radius")), ""
    if (form := forms.get("mesh")) is not None:
        return Shape.MESH, _numbers(form, "scale", (1.0, 1.0, 1.0)), form.get("filename", "")
    raise TtError(f"{name} of the robot description has geometry {sorted(forms)}, wanted box, cylinder, sphere or mesh")


def _colour(robot: ET.Element, visual: ET.Element) -> Colour | None:
    """Return the colour of a visual element; None if it has none. A material without a colour is looked up among those of the robot."""
    material = visual.find("material")
    if material is None:
        return None
    named = [other for other in robot.findall("material") if other.get("name") == material.get("name")]
    for one in (material, *named):
        colour = one.find("color")
        if colour is not None:
            red, green, blue, opacity = _numbers(colour, "rgba", (*GREY[:3], 1.0)).tolist()
            return red, green, blue, opacity
    return None


def _number(form: ET.Element, key: str) -> float:
    """Return the number in an XML attribute. Raises TtError if there is none."""
    return float(_numbers(form, key, (math.nan,))[0])


def _numbers(element: ET.Element | None, key: str, default: tuple[float, ...]) -> Array:
    """Return the numbers in an XML attribute. Raises TtError if they are not as many as in `default`, or not finite."""
    text = None if element is None else element.get(key)
    if text is None and not any(map(math.isnan, default)):
        return np.array(default)
    try:
        values = [float(word) for word in (text or "").split()]
    except ValueError as error:
        raise TtError(f"{key} = {text!r} of the robot description must be numbers separated by spaces") from error
    if len(values) != len(default) or not all(map(math.isfinite, values)):
        raise TtError(f"{key} = {text!r} of the robot description must be {len(default)} finite numbers")
    return np.array(values)
