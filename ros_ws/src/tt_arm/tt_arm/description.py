"""Description of the arm for other programs: its URDF with the arm placed in the frame `table`."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import pinocchio as pin
from tt_core.errors import TtError

ROOT = "table"  # link that is added as the root


def placed_description(urdf: str, base: pin.SE3) -> str:
    """Return a URDF whose root link is `table`, with an added fixed joint `table_to_base` from `table` to the former root link.

    Args:
        urdf: URDF of the arm, as XML text. If its root link already is `table`, it is not changed.
        base: Pose of the former root link in `table`.

    Raises:
        TtError: The text is no URDF with one root link.
    """
    try:
        robot = ET.fromstring(urdf)
    except ET.ParseError as error:
        raise TtError(f"the robot description is no XML: {error}") from error
    children = {child.get("link") for child in robot.iterfind("joint/child")}
    roots = [link.get("name", "") for link in robot.findall("link") if link.get("name") not in children]
    if len(roots) != 1:
        raise TtError(f"the robot description has {len(roots)} root links {roots}, wanted 1")
    if roots != [ROOT]:
        joint = ET.Element("joint", name="table_to_base", type="fixed")
        ET.SubElement(joint, "parent", link=ROOT)
        ET.SubElement(joint, "child", link=roots[0])
        ET.SubElement(joint, "origin", xyz=_numbers(base.translation), rpy=_numbers(pin.rpy.matrixToRpy(base.rotation)))
        robot[:0] = [ET.Element("link", name=ROOT), joint]
    return ET.tostring(robot, encoding="unicode")


def _numbers(values: Sequence[float]) -> str:
    return " ".join(f"{value:.17g}" for value in values)
