"""Items: the simple shapes of which a 3D scene is made, independent of the program that draws them."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from tt_core.arrays import Array

Colour = tuple[float, float, float, float]  # red, green, blue, opacity, each 0 to 1


class Shape(Enum):
    """Shape of an item. Boxes, cylinders and ellipsoids have their origin in their centre; the axis of a cylinder is its z axis."""

    BOX = "box"
    CYLINDER = "cylinder"
    ELLIPSOID = "ellipsoid"
    MESH = "mesh"
    LINE = "line"
    ARROW = "arrow"


@dataclass(frozen=True, slots=True, eq=False)
class Item:
    """One shape of a 3D scene.

    Attributes:
        name: Unique name, with a group before a slash, e.g. "arm/link_s1/0". A new item replaces the older one of the same name.
        shape: Its shape.
        colour: Red, green, blue and opacity, each 0 to 1.
        size: (3,) m. Box: lengths of its edges. Cylinder: its diameter twice, and its length. Ellipsoid: its three diameters. Mesh: its
            scale along x, y and z (no unit). Line: its width, and two numbers without meaning. Arrow: diameter of the shaft, diameter and
            length of the head.
        position: (3,) m, its origin in the frame `table`.
        rotation: (3, 3) rotation matrix from the item to the frame `table`.
        points: (n, 3) m in the frame `table`: the corners of a line, or start and tip of an arrow; (0, 3) for other shapes.
        mesh: File of a mesh, as in the URDF: a path, file:// or package://; "" for other shapes.
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
    """Return a box whose edges are parallel to the axes of the frame `table`.

    Args:
        name: Name of the item.
        colour: Its colour.
        size: Lengths of its edges along x, y and z, m.
        position: Its centre in `table`, m.
    """
    return Item(name, Shape.BOX, colour, np.array(size), np.array(position))


def ball(name: str, colour: Colour, radius: float, position: Array) -> Item:
    """Return a sphere.

    Args:
        name: Name of the item.
        colour: Its colour.
        radius: Its radius, m.
        position: (3,) m, its centre in the frame `table`.
    """
    return Item(name, Shape.ELLIPSOID, colour, np.full(3, 2.0 * radius), np.array(position))


def ellipsoid(name: str, colour: Colour, position: Array, covariance: Array, sigmas: float) -> Item:
    """Return the ellipsoid that shows the uncertainty of a position.

    Args:
        name: Name of the item.
        colour: Its colour.
        position: (3,) m, its centre in the frame `table`.
        covariance: (3, 3) m^2, covariance of the position.
        sigmas: Length of its half axes in standard deviations.
    """
    values, axes = np.linalg.eigh(covariance)
    if np.linalg.det(axes) < 0.0:
        axes = axes * np.array([1.0, 1.0, -1.0])  # makes it a rotation instead of a reflection
    return Item(name, Shape.ELLIPSOID, colour, 2.0 * sigmas * np.sqrt(np.maximum(values, 1e-12)), np.array(position), axes)


def disc(name: str, colour: Colour, radius: float, thickness: float, position: Array, rotation: Array) -> Item:
    """Return a disc.

    Args:
        name: Name of the item.
        colour: Its colour.
        radius: Its radius, m.
        thickness: Its thickness, m.
        position: (3,) m, its centre in the frame `table`.
        rotation: (3, 3) rotation matrix to the frame `table`, whose third column is the axis of the disc.
    """
    return Item(name, Shape.CYLINDER, colour, np.array([2.0 * radius, 2.0 * radius, thickness]), np.array(position), np.array(rotation))


def line(name: str, colour: Colour, points: Array, width: float) -> Item:
    """Return a line that connects points.

    Args:
        name: Name of the item.
        colour: Its colour.
        points: (n, 3) m in the frame `table`.
        width: Its width, m.
    """
    return Item(name, Shape.LINE, colour, np.array([width, 0.0, 0.0]), points=np.array(points))


def arrow(name: str, colour: Colour, start: Array, tip: Array, shaft: float) -> Item:
    """Return an arrow.

    Args:
        name: Name of the item.
        colour: Its colour.
        start: (3,) m, its start in the frame `table`.
        tip: (3,) m, its tip in the frame `table`.
        shaft: Diameter of its shaft, m. The head is 2.5 such diameters thick and 3 long.
    """
    return Item(name, Shape.ARROW, colour, np.array([shaft, 2.5 * shaft, 3.0 * shaft]), points=np.array([start, tip]))
