"""Represent the bodies of an arm by capsules, from the collision elements of its URDF.

A capsule is the set of all points within a radius of a line segment. A sphere is a capsule of length 0. Cylinders, boxes and meshes are
enclosed in capsules, so that a distance to the capsules is never larger than the distance to the shapes themselves.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from tt_core.states import Array

from .meshes import triangles
from .urdf import CheckedUrdf, UrdfError, UrdfFailure, numbers

STRIPS = 4  # largest number of capsules side by side that enclose one box
MOST_SPLITS = 2  # how often a mesh is halved at most, so up to 4 capsules enclose it
WORTH = 0.7  # several capsules replace one if their volume is less than this share of its volume
LITTLE_MORE = 1.3  # one capsule replaces two if its volume is at most this multiple of theirs
RADIUS_SLACK = 1e-9  # m, added to a radius that is computed from points, for rounding
SHAPES = {"sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius", "length"), "box": ("size",), "mesh": ()}


class Capsule(NamedTuple):
    """A capsule: all points within `radius` of the line segment from `start` to `end`, in the frame of its link.

    Attributes:
        start: (3,) m, first end of the segment.
        end: (3,) m, second end of the segment.
        radius: m.
    """

    start: Array
    end: Array
    radius: float

    def moved(self, placement: pin.SE3) -> Capsule:
        """Return the capsule in another frame, for the pose of its present frame in that frame."""
        return Capsule(placement.act(self.start), placement.act(self.end), self.radius)

    @property
    def volume(self) -> float:
        """Volume, m^3."""
        length = float(np.linalg.norm(self.end - self.start))
        return float(np.pi * self.radius**2 * (length + 4.0 / 3.0 * self.radius))


def around_cylinder(radius: float, length: float) -> Capsule:
    """Return the capsule of least volume that encloses a cylinder along z with its centre at the origin.

    Args:
        radius: m, of the cylinder.
        length: m, of the cylinder.
    """
    cut = np.linspace(0.0, 0.5 * length, 65)  # m, by which each end of the segment stays inside the cylinder
    thickness, left = np.sqrt(radius**2 + cut**2), length - 2.0 * cut
    best = int(np.argmin(thickness**2 * (left + 4.0 / 3.0 * thickness)))
    top = np.array([0.0, 0.0, 0.5 * left[best]])
    return Capsule(-top, top, float(thickness[best]))


def around_box(size: Array) -> Iterator[Capsule]:
    """Yield capsules that enclose a box with its centre at the origin.

    They are parallel to the longest side. A plate is enclosed in several capsules side by side.

    Args:
        size: (3,) m, lengths of the sides.
    """
    thin, wide, long = (int(i) for i in np.argsort(size))
    count = int(min(STRIPS, max(1.0, round(size[wide] / max(size[thin], 1e-3)))))
    strip = size[wide] / count
    bound = around_cylinder(0.5 * float(np.hypot(size[thin], strip)), float(size[long]))
    for k in range(count):
        start, end = np.zeros(3), np.zeros(3)
        start[long], end[long] = bound.start[2], bound.end[2]
        start[wide] = end[wide] = -0.5 * size[wide] + (k + 0.5) * strip
        yield Capsule(start, end, bound.radius)


def around_points(points: Array) -> Capsule:
    """Return a capsule that encloses points (n, 3) m: the smallest of those along their principal axes and the axes of their frame."""
    middle = points.mean(axis=0)
    principal = np.linalg.svd(points - middle, full_matrices=False)[2] if len(points) >= 3 else np.eye(3)
    return min((_along(points, axis) for axis in (*principal, *np.eye(3))), key=lambda capsule: capsule.volume)


def _along(points: Array, axis: Array) -> Capsule:
    """Return a capsule that encloses points (n, 3) m, parallel to an axis (3,), through the centre of the points as seen along the axis."""
    height = points @ axis
    flat = points - np.outer(height, axis)
    centre = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
    for k in range(2, 66):  # towards the centre of the least circle around them (Badoiu and Clarkson)
        centre = centre + (flat[np.linalg.norm(flat - centre, axis=1).argmax()] - centre) / k
    centre = centre - (centre @ axis) * axis
    off = np.linalg.norm(flat - centre, axis=1)
    radius = float(off.max()) + RADIUS_SLACK
    ball = np.sqrt(radius**2 - off**2)  # how far beyond the segment a point so far off its line may be
    low, high = float((height + ball).min()), float((height - ball).max())
    if low > high:
        low = high = 0.5 * (low + high)
        radius = float(np.linalg.norm(points - (centre + low * axis), axis=1).max()) + RADIUS_SLACK
    return Capsule(centre + low * axis, centre + high * axis, radius)


def around_mesh(vertices: Array, corners: npt.NDArray[np.int64], splits: int = MOST_SPLITS) -> list[Capsule]:
    """Return capsules that enclose the triangles of a mesh.

    The set of triangles is divided along its longest extent where the capsules of both halves have clearly less volume.

    Args:
        vertices: (v, 3) m.
        corners: (t, 3) indices of the corners of each triangle.
        splits: How often the mesh may be halved.
    """
    points = vertices[np.unique(corners)]
    one = around_points(points)
    if splits == 0 or len(corners) < 2:
        return [one]
    centres = vertices[corners].mean(axis=1)
    axis = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][0]
    along = centres @ axis
    first = along < 0.5 * float((points @ axis).min() + (points @ axis).max())
    if first.all() or not first.any():
        return [one]
    parts = [*around_mesh(vertices, corners[first], splits - 1), *around_mesh(vertices, corners[~first], splits - 1)]
    return parts if sum(part.volume for part in parts) < WORTH * one.volume else [one]


def around_both(one: Capsule, other: Capsule) -> Capsule:
    """Return a capsule that encloses two others; its segment joins the two of their ends that are furthest from each other."""
    ends = [(end, capsule.radius) for capsule in (one, other) for end in (capsule.start, capsule.end)]
    start, end = max(((a, b) for a, _ in ends for b, _ in ends), key=lambda pair: float(np.linalg.norm(pair[1] - pair[0])))
    way = end - start
    square = max(float(way @ way), 1e-12)
    off = [float(np.linalg.norm(at - start - min(1.0, max(0.0, float((at - start) @ way) / square)) * way)) + radius for at, radius in ends]
    return Capsule(start, end, max(off))


def merged(parts: list[Capsule]) -> list[Capsule]:
    """Return fewer capsules that enclose the given ones: two are replaced by one as long as this needs little more volume."""
    parts = list(parts)
    while len(parts) > 1:
        best, i, k = min(
            (around_both(parts[i], parts[k]).volume / (parts[i].volume + parts[k].volume), i, k)
            for k in range(len(parts))
            for i in range(k)
        )
        if best > LITTLE_MORE:
            break
        both = around_both(parts[i], parts[k])
        parts = [part for m, part in enumerate(parts) if m not in (i, k)] + [both]
    return parts


def capsules(description: CheckedUrdf) -> dict[str, list[Capsule]]:
    """Return the capsules that enclose the collision elements of each link of an arm.

    Args:
        description: The checked URDF of the arm.

    Returns:
        For each link's name the capsules in the frame of the link; an empty list for a link without collision elements.

    Raises:
        UrdfError: A collision element cannot be used.
    """
    robot = ET.fromstring(description.xml)
    return {
        str(link.get("name")): [capsule for element in link.findall("collision") for capsule in _around(description.urdf, link, element)]
        for link in robot.findall("link")
    }


def _around(urdf: str, link: ET.Element, element: ET.Element) -> list[Capsule]:
    """Return the capsules that enclose one collision element, in the frame of its link. Raises UrdfError."""
    name, geometry, origin = str(link.get("name")), element.find("geometry"), element.find("origin")
    xyz, rpy = np.zeros(3), np.zeros(3)
    if origin is not None:
        xyz, rpy = (numbers(urdf, f"collision of link {name}", origin, (attribute, 3, "0 0 0")) for attribute in ("xyz", "rpy"))
    placed = pin.SE3(pin.rpy.rpyToMatrix(*rpy), xyz)
    shapes = [] if geometry is None else [shape for shape in geometry if isinstance(shape.tag, str)]
    if len(shapes) != 1 or shapes[0].tag not in SHAPES:
        raise UrdfError(UrdfFailure.NO_SHAPE, urdf=urdf, link=name, shape=[shape.tag for shape in shapes])
    shape = shapes[0]
    size = {a: numbers(urdf, f"collision of link {name}", shape, (a, 3 if a == "size" else 1, "")) for a in SHAPES[shape.tag]}
    for attribute, values in size.items():
        if (values <= 0.0).any():
            raise UrdfError(UrdfFailure.WRONG_SIZE, urdf=urdf, link=name, shape=shape.tag, attribute=attribute, value=float(values.min()))
    return [capsule.moved(placed) for capsule in _capsules(urdf, name, shape, size)]


def _capsules(urdf: str, link: str, shape: ET.Element, size: dict[str, Array]) -> list[Capsule]:
    """Return the capsules that enclose a shape, in the frame of the shape. Raises UrdfError for a mesh that cannot be read."""
    if shape.tag == "box":
        return list(around_box(size["size"]))
    if shape.tag == "cylinder":
        return [around_cylinder(size["radius"][0], size["length"][0])]
    if shape.tag in ("sphere", "capsule"):
        top = np.array([0.0, 0.0, 0.5 * size["length"][0] if shape.tag == "capsule" else 0.0])
        return [Capsule(-top, top, float(size["radius"][0]))]
    scale, file = numbers(urdf, f"collision of link {link}", shape, ("scale", 3, "1 1 1")), str(shape.get("filename"))
    try:
        vertices, corners = triangles(Path(file), scale)
        if len(corners) == 0 or not np.isfinite(vertices).all():
            raise ValueError(f"{len(corners)} triangles")
    except (ValueError, RuntimeError) as error:
        raise UrdfError(UrdfFailure.BAD_MESH, urdf=urdf, link=link, mesh=file, error=error) from error
    return around_mesh(vertices, corners)
