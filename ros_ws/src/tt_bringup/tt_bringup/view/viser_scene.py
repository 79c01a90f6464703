"""Draw items (simple shapes) with viser. Only changes are sent to the browsers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote, urlparse

import numpy as np
import trimesh
import viser
from ament_index_python.packages import get_package_share_directory
from scipy.spatial.transform import Rotation
from tt_core.arrays import Array

from .items import Item, Shape


class _Drawn(NamedTuple):
    """An item that is drawn, and its viser handle."""

    item: Item
    handle: Any


class ViserScene:
    """The 3D scene of a viser server.

    Attributes:
        missing: Places of meshes that could not be loaded, as in the URDF. They are not drawn.
    """

    def __init__(self, scene: viser.SceneApi) -> None:
        """Begin with an empty scene."""
        self._scene = scene
        self._drawn: dict[str, _Drawn] = {}  # by the name of the item
        self.missing: set[str] = set()

    def draw(self, items: Sequence[Item]) -> None:
        """Make the scene show these items and no others."""
        wanted = {item.name: item for item in items}
        for name in self._drawn.keys() - wanted.keys():
            self._remove(name)
        for name, item in wanted.items():
            before = self._drawn.get(name)
            if before is not None and before.item is item:
                continue
            if before is None or not _is_same_form(before.item, item):
                self._remove(name)
                handle = self._add(item)
                if handle is None:
                    continue
            else:
                handle = before.handle
                _move(handle, item)
            self._drawn[name] = _Drawn(item, handle)

    def _remove(self, name: str) -> None:
        if name in self._drawn:
            self._drawn.pop(name).handle.remove()

    def _add(self, item: Item) -> Any:
        """Return the handle of a new item; None for a mesh that cannot be loaded."""
        name, (red, green, blue, opacity), size = f"/{item.name}", item.colour, item.size
        colour = (int(255 * red), int(255 * green), int(255 * blue))
        if item.shape is Shape.LINE:
            return self._scene.add_line_segments(name, _segments(item.points), colour, thickness=float(size[0]))
        if item.shape is Shape.ARROW:
            shaft, head, length = size.tolist()
            sizes = {"shaft_radius": 0.5 * shaft, "head_radius": 0.5 * head, "head_length": length}
            return self._scene.add_arrows(name, _float32(item.points[None]), colour, **sizes)
        style: dict[str, Any] = {"color": colour, "opacity": None if opacity >= 1.0 else opacity, "cast_shadow": False}
        style |= {"wxyz": _wxyz(item.rotation), "position": item.position}
        if item.shape is Shape.BOX:
            return self._scene.add_box(name, dimensions=size, **style)
        if item.shape is Shape.CYLINDER:
            return self._scene.add_cylinder(name, radius=0.5 * size[0], height=size[2], **style)
        if item.shape is Shape.ELLIPSOID:
            return self._scene.add_icosphere(name, radius=0.5, scale=tuple(size.tolist()), **style)
        mesh = self._mesh(item.mesh)
        if mesh is None:
            return None
        return self._scene.add_mesh_simple(name, _float32(mesh.vertices * size), np.array(mesh.faces), **style)

    def _mesh(self, place: str) -> trimesh.Trimesh | None:
        """Load a mesh. Return None, and add it to `missing`, if that fails for any reason."""
        if place in self.missing:
            return None
        try:
            return trimesh.load(mesh_file(place), force="mesh")  # type: ignore[return-value]
        except Exception:  # the loaders raise all kinds of errors for broken files
            self.missing.add(place)
            return None


def mesh_file(place: str) -> Path:
    """Return the file of a mesh that a URDF names by a path, file:// or package://. Raises PackageNotFoundError if there is no package."""
    url = urlparse(place)
    if url.scheme == "package":
        return Path(get_package_share_directory(url.netloc)) / unquote(url.path).lstrip("/")
    return Path(unquote(url.path) if url.scheme == "file" else place)


def _is_same_form(a: Item, b: Item) -> bool:
    """Return whether two items differ in nothing but name, position, rotation and points."""
    return a.shape is b.shape and a.colour == b.colour and a.mesh == b.mesh and np.array_equal(a.size, b.size)


def _move(handle: Any, item: Item) -> None:
    """Move a drawn item to the place of an item of the same form."""
    if item.shape is Shape.LINE:
        handle.points = _segments(item.points)
    elif item.shape is Shape.ARROW:
        handle.points = _float32(item.points[None])
    else:
        handle.wxyz, handle.position = _wxyz(item.rotation), item.position


def _segments(points: Array) -> np.ndarray:
    """Return the segments (n - 1, 2, 3) of a line through points (n, 3)."""
    return _float32(np.stack([points[:-1], points[1:]], axis=1))


def _float32(array: Array) -> np.ndarray:
    return np.ascontiguousarray(array, dtype=np.float32)


def _wxyz(rotation: Array) -> Array:
    return Rotation.from_matrix(rotation).as_quat(scalar_first=True)
