"""The description of the arm as other programs read it: the URDF with the arm placed in `table` and the racket on its mount."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence

from tt_core.errors import TtError, check_array

ROOT = "table"  # link that is added as the root
RACKET = "racket"  # link of the racket


def placed_description(urdf: str, base: Sequence[float], mount: Sequence[float]) -> str:
    """Return a URDF whose root is the frame `table`.

    A fixed joint `table_to_base` from `table` to the former root link is added, and the fixed joint that holds the racket gets the mount.

    Args:
        urdf: The description of the arm, XML.
        base: x, y, z (m) and yaw (rad) of the former root link in `table`.
        mount: Distance (m) of the racket beyond its parent link along z, and its angle (rad) about y.

    Raises:
        TtError: The text is no URDF with one root link.
        BadShape: `base` or `mount` has another length.
    """
    x, y, z, yaw = check_array("base", base, (4,))
    ahead, tilt = check_array("mount", mount, (2,))
    try:
        robot = ET.fromstring(urdf)
    except ET.ParseError as error:
        raise TtError(f"the robot description is no XML: {error}") from error
    joints = robot.findall("joint")
    children = {joint.find("child").get("link"): joint for joint in joints if joint.find("child") is not None}  # type: ignore[union-attr]
    roots = [link.get("name", "") for link in robot.findall("link") if link.get("name") not in children]
    if len(roots) != 1:
        raise TtError(f"the robot description has {len(roots)} root links {roots}, wanted 1")
    if RACKET in children:
        _place(children[RACKET], (0.0, 0.0, ahead), (0.0, tilt, 0.0))
    if roots != [ROOT]:
        joint = ET.Element("joint", name="table_to_base", type="fixed")
        ET.SubElement(joint, "parent", link=ROOT)
        ET.SubElement(joint, "child", link=roots[0])
        _place(joint, (x, y, z), (0.0, 0.0, yaw))
        robot[:0] = [ET.Element("link", name=ROOT), joint]
    return ET.tostring(robot, encoding="unicode")


def _place(joint: ET.Element, xyz: Sequence[float], rpy: Sequence[float]) -> None:
    """Set the origin of a joint: xyz in m, roll, pitch and yaw in rad."""
    for origin in joint.findall("origin"):
        joint.remove(origin)
    ET.SubElement(joint, "origin", xyz=" ".join(f"{v:.17g}" for v in xyz), rpy=" ".join(f"{v:.17g}" for v in rpy))
