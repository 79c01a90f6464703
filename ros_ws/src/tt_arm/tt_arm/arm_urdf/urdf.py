"""Read and check a URDF, and change it to an arm with one chain of moving joints from the root link to the racket.

All other joints are fixed or left out. Every defect of the file raises an error with the name of the joint or link and its numbers. The
result is a URDF, too, which pinocchio can read.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

import numpy as np
import pinocchio as pin
from tt_core.constants import RACKET_RADIUS
from tt_core.errors import TtError
from tt_core.states import Array

from .meshes import MeshNotFound, resolve

LEAST_JOINTS, MOST_JOINTS = 5, 8  # numbers of moving joints; position and normal of the racket's face are five conditions
RACKET_LINK = "racket"  # name of the link that is the racket
RACKET_MASS = 0.18  # kg, of a usual racket with its rubbers
RACKET_THICKNESS = 0.014  # m, blade and rubbers
TURNS = 2.0 * math.pi  # rad, limit of a continuous joint in both directions, because the cable of a racket or a gripper winds up
LARGEST_SPEED, LARGEST_EFFORT = 100.0, 1e5  # rad/s or m/s, N m or N; a larger number cannot be the limit of a real joint
LIMITS = ("lower", "upper", "velocity", "effort", "acceleration", "jerk")  # attributes of a joint's limits
MOVING = {"revolute": "rad", "continuous": "rad", "prismatic": "m"}  # types of joints that an arm may have, and their unit


class UrdfFailure(Enum):
    """Codes of failures: why a URDF cannot be used."""

    NOT_READABLE = "urdf = {urdf!r} cannot be read: {error}"
    NOT_A_URDF = "urdf = {urdf!r} is no URDF: its root element is <{tag}>, wanted <robot>; expand a xacro file first"
    BAD_NUMBER = "urdf = {urdf!r}: {where} has {attribute} = {text!r}, wanted {count} finite numbers"
    DUPLICATE = "urdf = {urdf!r} has {count} {kind}s named {name}"
    NO_NAME = "urdf = {urdf!r} has a {kind} without a name"
    UNKNOWN_LINK = "urdf = {urdf!r}: {where} names the link {link!r}, which is not in the file; it has {count} links"
    UNKNOWN_JOINT = "urdf = {urdf!r}: {where} names the joint {joint!r}, which is not in the file; it has {count} joints"
    CLOSED_CHAIN = "urdf = {urdf!r} has a closed chain: {count} links have more than one way to the root or none, among them {link}"
    SEVERAL_ROOTS = "urdf = {urdf!r} has {count} root links {links}, wanted 1"
    UNKNOWN_TIP = "urdf = {urdf!r} has no link {tip!r} to mount the racket on; its {count} links without a child are {links}"
    SEVERAL_TIPS = "urdf = {urdf!r} has {count} links without a child, {links}: name the one that the racket is mounted on"
    ON_THE_CHAIN = "urdf = {urdf!r}: link {link} is on the way to {tip} and cannot be left out"
    WRONG_COUNT = "urdf = {urdf!r} has {count} moving joints {joints} from the root to {tip}, wanted {least} to {most}"
    WRONG_TYPE = "urdf = {urdf!r}: joint {joint} is of type {kind!r}, wanted one of {wanted}"
    ZERO_AXIS = "urdf = {urdf!r}: joint {joint} has the axis {axis}"
    MIMIC = "urdf = {urdf!r}: joint {joint} copies joint {other}; fix it, or leave its link out, by name"
    NO_LIMITS = "urdf = {urdf!r}: joint {joint} has no limit of {missing}; state it in the URDF or in the parameters"
    WRONG_LIMITS = "urdf = {urdf!r}: joint {joint} has limits {low:g} to {high:g} {unit}, {speed:g} {unit}/s, {effort:g} of effort"
    WRONG_LIMIT = "urdf = {urdf!r}: joint {joint} has {attribute} = {value}, wanted a positive number"
    WRONG_MASS = "urdf = {urdf!r}: link {link} has a mass of {mass:g} kg and the least principal inertia {inertia:g} kg m^2"
    RACKET_ELSEWHERE = "urdf = {urdf!r}: the link {racket} is not fixed to {tip}"
    NO_SHAPE = "urdf = {urdf!r}: link {link} has a collision element with {shape!r}, wanted one box, cylinder, capsule, sphere or mesh"
    WRONG_SIZE = "urdf = {urdf!r}: link {link} has a {shape} with {attribute} = {value:g}"
    NO_MESH = "urdf = {urdf!r}: link {link} has the mesh {mesh!r}, which is at none of {count} places: {places}"
    BAD_MESH = "urdf = {urdf!r}: link {link} has the mesh {mesh!r}, which cannot be read: {error}"


class UrdfError(TtError):
    """A URDF that cannot be used; its failure has a code of UrdfFailure."""


@dataclass(frozen=True)
class UrdfOptions:
    """Changes that are made to a URDF when it is read.

    Attributes:
        limits: For each joint's name the limits that replace those of the URDF, by their names in LIMITS; in rad or m, s, and N m or N.
        fixed: Positions (rad or m) at which moving joints are fixed, by their names. A joint outside the chain that is not named here is
            fixed at 0, or at the limit nearest to 0; a joint that mimics another one is fixed accordingly.
        left_out: Names of links that are removed together with everything attached to them.
    """

    limits: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    fixed: Mapping[str, float] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()


@dataclass(frozen=True)
class JointDescription:
    """Name and limits of one moving joint of the arm.

    Attributes:
        name: Name in the URDF.
        unit: Unit of the position, "rad" or "m".
        low: rad or m, lowest position.
        high: rad or m, highest position.
        speed: rad/s or m/s, speed limit for both directions.
        effort: N m or N, rated torque or force.
        acceleration: rad/s^2 or m/s^2, acceleration limit; None if none is stated.
        jerk: rad/s^3 or m/s^3, jerk limit; None if none is stated.
    """

    name: str
    unit: str
    low: float
    high: float
    speed: float
    effort: float
    acceleration: float | None
    jerk: float | None


@dataclass(frozen=True)
class CheckedUrdf:
    """Checked URDF of an arm with its racket.

    Attributes:
        urdf: Path of the file from which it was read.
        xml: URDF of the arm as text, with a link named `racket`. Only the joints of the chain can move, and meshes have absolute paths.
        joints: Moving joints in the order from the root link to the racket.
    """

    urdf: str
    xml: str
    joints: tuple[JointDescription, ...]


def numbers(urdf: str, where: str, element: ET.Element, wanted: tuple[str, int, str]) -> Array:
    """Return the numbers in an attribute of an XML element.

    Args:
        urdf: Path of the file, for the error.
        where: Description of the element, for the error.
        element: Element that has the attribute.
        wanted: Name of the attribute, wanted count of numbers, and the text that is used if there is no such attribute.

    Returns:
        (count,) numbers.

    Raises:
        UrdfError: The count of numbers is wrong, or one is not finite.
    """
    attribute, count, default = wanted
    text = element.get(attribute, default)
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.empty(0)
    if len(values) != count or not np.isfinite(values).all():
        raise UrdfError(UrdfFailure.BAD_NUMBER, urdf=urdf, where=where, attribute=attribute, text=text, count=count)
    return values


class _Tree:
    """Tree of the links and joints of a URDF, by name; every link is connected with the root link in exactly one way."""

    def __init__(self, urdf: str) -> None:
        """Read and check the structure; raise UrdfError."""
        self.urdf = urdf
        try:
            self.robot = ET.parse(urdf).getroot()
        except (OSError, ET.ParseError, ValueError) as error:
            raise UrdfError(UrdfFailure.NOT_READABLE, urdf=urdf, error=error) from error
        if self.robot.tag != "robot" or any("xacro" in str(e.tag) for e in self.robot.iter()):
            tag = next((str(e.tag) for e in self.robot.iter() if "xacro" in str(e.tag)), self.robot.tag)
            raise UrdfError(UrdfFailure.NOT_A_URDF, urdf=urdf, tag=tag)
        for unused in [e for e in self.robot if e.tag not in ("link", "joint", "material")]:  # plugins, transmissions, ros2_control
            self.robot.remove(unused)
        self.links, self.joints = self._named("link"), self._named("joint")
        if not self.links:
            raise UrdfError(UrdfFailure.SEVERAL_ROOTS, urdf=urdf, count=0, links=[])
        self.above: dict[str, ET.Element] = {}  # the joint above each link
        self.parent = {name: self._end(joint, "parent") for name, joint in self.joints.items()}
        self.child = {name: self._end(joint, "child") for name, joint in self.joints.items()}
        children = list(self.child.values())
        for name, link in self.child.items():
            if children.count(link) > 1:
                raise UrdfError(UrdfFailure.CLOSED_CHAIN, urdf=urdf, count=sum(children.count(c) > 1 for c in set(children)), link=link)
            self.above[link] = self.joints[name]
        roots = [link for link in self.links if link not in self.above]
        if len(roots) > 1:
            raise UrdfError(UrdfFailure.SEVERAL_ROOTS, urdf=urdf, count=len(roots), links=roots)
        reached = set(self.below(roots[0])) if roots else set()
        if len(reached) < len(self.links):
            lost = sorted(set(self.links) - reached)
            raise UrdfError(UrdfFailure.CLOSED_CHAIN, urdf=urdf, count=len(lost), link=lost[0])
        self.root = roots[0]
        for name in self.joints:
            self._check_joint(name)
        for name in self.links:
            self._check_mass(name)

    def _named(self, kind: str) -> dict[str, ET.Element]:
        found: dict[str, ET.Element] = {}
        for element in self.robot.findall(kind):
            name = element.get("name")
            if not name:
                raise UrdfError(UrdfFailure.NO_NAME, urdf=self.urdf, kind=kind)
            if name in found:
                count = sum(e.get("name") == name for e in self.robot.findall(kind))
                raise UrdfError(UrdfFailure.DUPLICATE, urdf=self.urdf, kind=kind, name=name, count=count)
            found[name] = element
        return found

    def _end(self, joint: ET.Element, which: str) -> str:
        element = joint.find(which)
        link = "" if element is None else element.get("link", "")
        if link not in self.links:
            where = f"joint {joint.get('name')} ({which})"
            raise UrdfError(UrdfFailure.UNKNOWN_LINK, urdf=self.urdf, where=where, link=link, count=len(self.links))
        return link

    def _check_joint(self, name: str) -> None:
        joint = self.joints[name]
        if joint.get("type") not in (*MOVING, "fixed", "floating", "planar"):
            raise UrdfError(UrdfFailure.WRONG_TYPE, urdf=self.urdf, joint=name, kind=joint.get("type"), wanted=(*MOVING, "fixed"))
        self.origin(joint, f"joint {name}")
        if joint.get("type") in MOVING and np.linalg.norm(self.axis(joint)) < 1e-9:
            raise UrdfError(UrdfFailure.ZERO_AXIS, urdf=self.urdf, joint=name, axis=self.axis(joint).tolist())

    def _check_mass(self, name: str) -> None:
        inertial = self.links[name].find("inertial")
        if inertial is None:
            return
        self.origin(inertial, f"inertial of link {name}")
        where = f"link {name}"
        mass, inertia = inertial.find("mass"), inertial.find("inertia")
        kilograms = 0.0 if mass is None else self.numbers(mass, "value", 1, where)[0]
        least = 0.0
        if inertia is not None:
            xx, xy, xz, yy, yz, zz = (self.numbers(inertia, a, 1, where, "0")[0] for a in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
            least = float(np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])[0])
        if kilograms < 0.0 or least < -1e-6 * max(1.0, kilograms):
            raise UrdfError(UrdfFailure.WRONG_MASS, urdf=self.urdf, link=name, mass=kilograms, inertia=least)

    def numbers(self, element: ET.Element, attribute: str, count: int, where: str, default: str = "") -> Array:
        """Return the numbers in an attribute of an XML element of this file.

        Args:
            element: Element that has the attribute.
            attribute: Name of the attribute.
            count: Wanted count of numbers.
            where: Description of the element, for the error.
            default: Text that is used if there is no such attribute.
        """
        return numbers(self.urdf, where, element, (attribute, count, default))

    def origin(self, element: ET.Element, where: str) -> pin.SE3:
        """Return the pose that the <origin> of an element states; `where` describes the element in errors."""
        origin = element.find("origin")
        if origin is None:
            return pin.SE3.Identity()
        xyz, rpy = (self.numbers(origin, attribute, 3, where, "0 0 0") for attribute in ("xyz", "rpy"))
        return pin.SE3(pin.rpy.rpyToMatrix(*rpy), xyz)

    def axis(self, joint: ET.Element) -> Array:
        """Return the axis (3,) of a joint as it is stated, not normalised; x, the default of the format, if none is stated."""
        axis = joint.find("axis")
        return np.array([1.0, 0.0, 0.0]) if axis is None else self.numbers(axis, "xyz", 3, f"joint {joint.get('name')}", "1 0 0")

    def below(self, link: str) -> Iterator[str]:
        """Yield the name of a link and of all links that are attached to it, directly or through others."""
        links = [link]
        while links:
            yield links[-1]
            link = links.pop()
            links += [self.child[name] for name, parent in self.parent.items() if parent == link]

    def chain(self, tip: str) -> list[str]:
        """Return the names of the joints from the root link to the link `tip`, in this order."""
        names: list[str] = []
        while tip in self.above:
            names.append(str(self.above[tip].get("name")))
            tip = self.parent[names[-1]]
        return names[::-1]

    def leave_out(self, link: str) -> None:
        """Remove a link, the joint above it, and everything attached to it."""
        for name in list(self.below(link)):
            joint = str(self.above.pop(name).get("name"))
            self.robot.remove(self.links.pop(name))
            self.robot.remove(self.joints.pop(joint))
            del self.parent[joint], self.child[joint]

    def leaves(self) -> list[str]:
        """Return the names of the links to which no other link is attached."""
        return [link for link in self.links if link not in self.parent.values()]


def read_urdf(urdf: str, tip: str | None, mount: pin.SE3 | None, options: UrdfOptions) -> CheckedUrdf:
    """Read and check the URDF of an arm, mount the racket, and fix all joints that do not belong to the arm.

    Args:
        urdf: Path of the file.
        tip: Name of the link on which the racket is mounted; None for the only link to which no other link is attached.
        mount: Pose of the racket in the frame of the tip; None keeps the pose of the URDF's own racket, or puts a racket at the tip.
        options: Joints to fix, links to leave out, and limits that replace those of the URDF.

    Returns:
        The arm as a checked URDF.

    Raises:
        UrdfError: The file cannot be used.
    """
    tree = _Tree(urdf)
    _check_names(tree, options)
    for link in options.left_out:
        if link in tree.links:
            _leave_out(tree, link, tip)
    tip = _tip(tree, tip)
    chain = tree.chain(tip)
    _put_racket(tree, tip, mount)
    for name in tree.joints:
        if name not in chain or name in options.fixed:
            _fix(tree, name, chain, options.fixed)
    moving = [name for name in chain if tree.joints[name].get("type") != "fixed"]
    for name in moving:
        _check_moving(tree, name)
    if not LEAST_JOINTS <= len(moving) <= MOST_JOINTS:
        values = {"count": len(moving), "joints": moving, "tip": tip, "least": LEAST_JOINTS, "most": MOST_JOINTS}
        raise UrdfError(UrdfFailure.WRONG_COUNT, urdf=urdf, **values)
    joints = tuple(_limits(tree, name, options.limits.get(name, {})) for name in moving)
    for name, element in tree.links.items():
        for visual in element.findall("visual"):
            if not _is_found(tree, visual):
                element.remove(visual)
        _find_meshes(tree, name)
    return CheckedUrdf(urdf, ET.tostring(tree.robot, encoding="unicode"), joints)


def _check_names(tree: _Tree, options: UrdfOptions) -> None:
    """Raise UrdfError if an option names a joint or link that is not in the URDF."""
    for where, names in (("limits", options.limits), ("fixed", options.fixed)):
        for name in names:
            if name not in tree.joints:
                raise UrdfError(UrdfFailure.UNKNOWN_JOINT, urdf=tree.urdf, where=where, joint=name, count=len(tree.joints))
    for link in options.left_out:
        if link not in tree.links:
            raise UrdfError(UrdfFailure.UNKNOWN_LINK, urdf=tree.urdf, where="left_out", link=link, count=len(tree.links))


def _leave_out(tree: _Tree, link: str, tip: str | None) -> None:
    if link == tree.root or (tip is not None and tip in tree.below(link)):
        raise UrdfError(UrdfFailure.ON_THE_CHAIN, urdf=tree.urdf, link=link, tip=tip)
    tree.leave_out(link)


def _tip(tree: _Tree, tip: str | None) -> str:
    leaves = tree.leaves()
    if tip is None and len(leaves) == 1:
        return leaves[0]
    if tip is None:
        raise UrdfError(UrdfFailure.SEVERAL_TIPS, urdf=tree.urdf, count=len(leaves), links=leaves)
    if tip not in tree.links:
        raise UrdfError(UrdfFailure.UNKNOWN_TIP, urdf=tree.urdf, tip=tip, count=len(leaves), links=leaves)
    return tip


def _set_origin(element: ET.Element, placement: pin.SE3) -> None:
    """Write a pose as the <origin> of an element."""
    origin = element.find("origin")
    if origin is None:
        origin = ET.SubElement(element, "origin")
    for attribute, values in (("xyz", placement.translation), ("rpy", pin.rpy.matrixToRpy(placement.rotation))):
        origin.set(attribute, " ".join(repr(float(value)) for value in values))


def _put_racket(tree: _Tree, tip: str, mount: pin.SE3 | None) -> None:
    """Put the racket of the URDF, or else a usual racket, at the mount."""
    if RACKET_LINK in tree.links:
        joint = tree.above.get(RACKET_LINK)
        fixed = joint is not None and joint.get("type") == "fixed"
        if tip == RACKET_LINK and (mount is None or (fixed and joint is not None)):
            if mount is not None and joint is not None:
                _set_origin(joint, tree.origin(joint, "racket") * mount)
            return
        if joint is None or not fixed or tree.parent[str(joint.get("name"))] != tip:
            raise UrdfError(UrdfFailure.RACKET_ELSEWHERE, urdf=tree.urdf, racket=RACKET_LINK, tip=tip)
        if mount is not None:
            _set_origin(joint, mount)
        return
    name = f"{RACKET_LINK}_mount"
    while name in tree.joints:
        name += "_"
    disc = RACKET_MASS * RACKET_RADIUS**2  # kg m^2
    blade = f'<geometry><cylinder radius="{RACKET_RADIUS}" length="{RACKET_THICKNESS}"/></geometry>'
    link = ET.fromstring(
        f'<link name="{RACKET_LINK}"><inertial><mass value="{RACKET_MASS}"/><inertia ixx="{disc / 4}" iyy="{disc / 4}" izz="{disc / 2}" '
        f'ixy="0" ixz="0" iyz="0"/></inertial><visual>{blade}</visual><collision>{blade}</collision></link>'
    )
    joint = ET.fromstring(f'<joint name="{name}" type="fixed"><parent link=""/><child link="{RACKET_LINK}"/></joint>')
    joint[0].set("link", tip)
    _set_origin(joint, mount or pin.SE3.Identity())
    tree.robot.extend([link, joint])
    tree.links[RACKET_LINK], tree.joints[name], tree.above[RACKET_LINK] = link, joint, joint
    tree.parent[name], tree.child[name] = tip, RACKET_LINK


def _fix(tree: _Tree, name: str, chain: list[str], fixed: Mapping[str, float]) -> None:
    """Change a moving joint to a fixed joint at the position that `_fixed_position` returns."""
    joint = tree.joints[name]
    kind = str(joint.get("type"))
    if kind in MOVING:
        at, axis = _fixed_position(tree, name, chain, fixed), tree.axis(joint)
        axis = axis / np.linalg.norm(axis)
        moved = pin.SE3(np.eye(3), at * axis) if kind == "prismatic" else pin.SE3(pin.exp3(at * axis), np.zeros(3))
        if at != 0.0:
            _set_origin(joint, tree.origin(joint, f"joint {name}") * moved)
    joint.set("type", "fixed")
    for element in [e for e in joint if e.tag not in ("origin", "parent", "child")]:
        joint.remove(element)


def _fixed_position(tree: _Tree, name: str, chain: list[str], fixed: Mapping[str, float]) -> float:
    """Return the position (rad or m) at which a joint is fixed."""
    joint = tree.joints[name]
    if name in fixed:
        if not math.isfinite(fixed[name]):
            raise UrdfError(UrdfFailure.BAD_NUMBER, urdf=tree.urdf, where="fixed", attribute=name, text=str(fixed[name]), count=1)
        return float(fixed[name])
    mimic = joint.find("mimic")
    if mimic is not None:
        other, where = mimic.get("joint", ""), f"joint {name} (mimic)"
        if other not in tree.joints:
            raise UrdfError(UrdfFailure.UNKNOWN_JOINT, urdf=tree.urdf, where=where, joint=other, count=len(tree.joints))
        if other in chain and other not in fixed:
            raise UrdfError(UrdfFailure.MIMIC, urdf=tree.urdf, joint=name, other=other)
        factor, offset = (tree.numbers(mimic, a, 1, where, d)[0] for a, d in (("multiplier", "1"), ("offset", "0")))
        return float(factor * fixed.get(other, 0.0) + offset)
    limit = joint.find("limit")
    if limit is None or joint.get("type") == "continuous":
        return 0.0
    low, high = (tree.numbers(limit, side, 1, f"joint {name}", "0")[0] for side in ("lower", "upper"))
    return float(min(max(0.0, low), high))


def _check_moving(tree: _Tree, name: str) -> None:
    joint = tree.joints[name]
    if joint.get("type") not in MOVING:
        raise UrdfError(UrdfFailure.WRONG_TYPE, urdf=tree.urdf, joint=name, kind=joint.get("type"), wanted=tuple(MOVING))
    mimic = joint.find("mimic")
    if mimic is not None:
        raise UrdfError(UrdfFailure.MIMIC, urdf=tree.urdf, joint=name, other=mimic.get("joint"))


def _limits(tree: _Tree, name: str, given: Mapping[str, float]) -> JointDescription:
    """Return the limits of a moving joint, and write them to the URDF, where the joint becomes revolute or prismatic."""
    joint = tree.joints[name]
    kind, element, where = str(joint.get("type")), joint.find("limit"), f"joint {name}"
    unknown = sorted(set(given) - set(LIMITS))
    if unknown:
        raise UrdfError(UrdfFailure.WRONG_LIMIT, urdf=tree.urdf, joint=name, attribute=unknown[0], value=given[unknown[0]])
    values: dict[str, float] = {"lower": -TURNS, "upper": TURNS} if kind == "continuous" else {}
    if element is not None:
        stated = [a for a in LIMITS if a in element.attrib and not (kind == "continuous" and a in ("lower", "upper"))]
        values |= {a: float(tree.numbers(element, a, 1, where)[0]) for a in stated}
        if kind != "continuous" and ("lower" in values) != ("upper" in values):  # 0 is the default of the format for one of them
            values = {"lower": 0.0, "upper": 0.0, **values}
    for attribute, value in given.items():
        if not math.isfinite(value):
            raise UrdfError(
                UrdfFailure.BAD_NUMBER, urdf=tree.urdf, where=f"limits of {name}", attribute=attribute, text=str(value), count=1
            )
        values[attribute] = float(value)
    missing = [a for a in LIMITS[:4] if a not in values]
    if missing:
        raise UrdfError(UrdfFailure.NO_LIMITS, urdf=tree.urdf, joint=name, missing=", ".join(missing))
    low, high, speed, effort = (values[a] for a in LIMITS[:4])
    if not (low < high and 0.0 < speed < LARGEST_SPEED and 0.0 < effort < LARGEST_EFFORT):
        numbers = {"low": low, "high": high, "speed": speed, "effort": effort, "unit": MOVING[kind]}
        raise UrdfError(UrdfFailure.WRONG_LIMITS, urdf=tree.urdf, joint=name, **numbers)
    for attribute in LIMITS[4:]:
        if values.get(attribute, 1.0) <= 0.0:
            raise UrdfError(UrdfFailure.WRONG_LIMIT, urdf=tree.urdf, joint=name, attribute=attribute, value=values[attribute])
    joint.set("type", "prismatic" if kind == "prismatic" else "revolute")
    for old in joint.findall("limit"):
        joint.remove(old)
    ET.SubElement(joint, "limit", {a: repr(values[a]) for a in LIMITS[:4]})
    return JointDescription(name, MOVING[kind], low, high, speed, effort, values.get("acceleration"), values.get("jerk"))


def _is_found(tree: _Tree, visual: ET.Element) -> bool:
    """Replace the mesh names of a visual element by absolute paths; return whether the files exist, because such meshes may be missing."""
    for mesh in visual.iter("mesh"):
        try:
            mesh.set("filename", str(resolve(mesh.get("filename", ""), Path(tree.urdf))))
        except MeshNotFound:
            return False
    return True


def _find_meshes(tree: _Tree, link: str) -> None:
    """Replace the mesh names of a link's collision elements by absolute paths; raise UrdfError for a file that does not exist."""
    for mesh in tree.links[link].iterfind("collision//mesh"):
        name = mesh.get("filename", "")
        try:
            mesh.set("filename", str(resolve(name, Path(tree.urdf))))
        except MeshNotFound as error:
            places = ", ".join(map(str, error.places))
            raise UrdfError(UrdfFailure.NO_MESH, urdf=tree.urdf, link=link, mesh=name, count=len(error.places), places=places) from error
