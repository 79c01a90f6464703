"""What is drawn: simple shapes with a name and a place in `table`, whatever program shows them."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from tt_core.arrays import Array

Colour = tuple[float, float, float, float]  # red, green, blue, opacity, each 0 to 1


class Shape(Enum):
    """Forms of an item. Cylinders stand along their own z axis, with the origin in the middle."""

    BOX = "box"
    CYLINDER = "cylinder"
    ELLIPSOID = "ellipsoid"
    MESH = "mesh"
    LINE = "line"
    ARROW = "arrow"


@dataclass(frozen=True, slots=True, eq=False)
class Item:
    """One thing that is drawn.

    Attributes:
        name: Of one item at a time, with the group before a slash, e.g. "arm/link_s1/0". An item of the same name replaces it.
        shape: Its form.
        colour: Red, green, blue and opacity.
        size: (3,) m: lengths of the edges of a box; two diameters and the length of a cylinder; three diameters of an ellipsoid; scale of a
            mesh (no unit). Of a line the first number is its width, of an arrow the diameter of the shaft, the diameter of the head and the
            length of the head.
        position: (3,) m, of its origin in `table`.
        rotation: (3, 3) item to `table`.
        points: (n, 3) m in `table`: the corners of a line, or start and tip of an arrow; (0, 3) for other shapes.
        mesh: Where the mesh is, as in the URDF: a path, file:// or package://.
    """

    name: str
    shape: Shape
    colour: Colour
    size: Array
    position: Array = field(default_factory=lambda: np.zeros(3))
    rotation: Array = field(default_factory=lambda: np.eye(3))
    points: Array = field(default_factory=lambda: np.zeros((0, 3)))
    mesh: str = ""


def box(name: str, colour: Colour, size: tuple[float, float, float], position: tuple[float, float, float]) -> Item:
    """Return a box whose edges are parallel to the axes of `table`."""
    return Item(name, Shape.BOX, colour, np.array(size), np.array(position))


def ball(name: str, colour: Colour, radius: float, position: Array) -> Item:
    """Return a ball."""
    return Item(name, Shape.ELLIPSOID, colour, np.full(3, 2.0 * radius), np.array(position))


def ellipsoid(name: str, colour: Colour, position: Array, covariance: Array, sigmas: float) -> Item:
    """Return the ellipsoid of a covariance (3, 3) m^2, whose half axes are `sigmas` standard deviations."""
    values, axes = np.linalg.eigh(covariance)
    if np.linalg.det(axes) < 0.0:
        axes = axes * np.array([1.0, 1.0, -1.0])  # a rotation, no mirror
    return Item(name, Shape.ELLIPSOID, colour, 2.0 * sigmas * np.sqrt(np.maximum(values, 1e-12)), np.array(position), axes)


def disc(name: str, colour: Colour, radius: float, thickness: float, position: Array, rotation: Array) -> Item:
    """Return a disc whose axis is the z axis of `rotation` (3, 3)."""
    return Item(name, Shape.CYLINDER, colour, np.array([2.0 * radius, 2.0 * radius, thickness]), np.array(position), np.array(rotation))


def line(name: str, colour: Colour, points: Array, width: float) -> Item:
    """Return a line through points (n, 3)."""
    return Item(name, Shape.LINE, colour, np.array([width, 0.0, 0.0]), points=np.array(points))


def arrow(name: str, colour: Colour, start: Array, tip: Array, shaft: float) -> Item:
    """Return an arrow; shaft: m, its diameter."""
    return Item(name, Shape.ARROW, colour, np.array([shaft, 2.5 * shaft, 3.0 * shaft]), points=np.array([start, tip]))
