"""Find the mesh files of a URDF, and read their triangles."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from urllib.parse import unquote, urlparse

import numpy as np
import numpy.typing as npt
from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from tt_core.errors import TtError
from tt_core.states import Array


class MeshNotFound(TtError):
    """The file of a mesh was not found.

    Attributes:
        places: Paths at which it was searched for.
    """

    def __init__(self, name: str, places: list[Path]) -> None:
        """Keep the paths."""
        super().__init__(f"{name} is at none of {', '.join(map(str, places))}")
        self.places = places


def resolve(name: str, urdf: Path) -> Path:
    """Find the file of a mesh.

    A name `package://PACKAGE/REST` or `model://PACKAGE/REST` is searched for in the ament index, then in the folder of the URDF and in all
    folders above it: as REST in a folder named PACKAGE, and as PACKAGE/REST; and last as REST beside the URDF. A name `file://PATH` is an
    absolute path. Any other name is a path, relative to the URDF if it is not absolute.

    Args:
        name: Name of the mesh in the URDF.
        urdf: Path of the URDF.

    Returns:
        Path of the file.

    Raises:
        MeshNotFound: There is no such file.
    """
    address, folder = urlparse(name), urdf.resolve().parent
    path = Path(unquote(address.path).lstrip("/"))
    if address.scheme in ("package", "model"):
        places = []
        with suppress(PackageNotFoundError, ValueError, LookupError):  # it may still be beside the file
            places.append(Path(get_package_share_directory(address.netloc)) / path)
        for around in (folder, *folder.parents):
            places += [around / path] if around.name == address.netloc else []
            places += [around / address.netloc / path]
        places.append(folder / path)
    elif address.scheme == "file":
        places = [Path("/") / path]
    else:
        places = [folder / name]
    for place in places:
        if place.is_file():
            return place
    raise MeshNotFound(name, places)


def triangles(path: Path, scale: Array) -> tuple[Array, npt.NDArray[np.int64]]:
    """Read the triangles of a mesh.

    Args:
        path: Path of an STL, DAE or OBJ file, or of any other file that assimp reads.
        scale: (3,) factors by which the coordinates are multiplied to be in m.

    Returns:
        Vertices (v, 3) m, and for each triangle the indices (t, 3) of its corners.

    Raises:
        ValueError: The file cannot be read.
        RuntimeError: The file cannot be read.
    """
    import coal  # takes 0.1 s, and only arms with meshes need it

    mesh = coal.MeshLoader().load(str(path), np.asarray(scale, dtype=float))
    corners = np.array(
        [[triangle[k] for k in range(3)] for triangle in (mesh.tri_indices(i) for i in range(mesh.num_tris))], dtype=np.int64
    )
    return np.array(mesh.vertices(), dtype=float).reshape(-1, 3), corners.reshape(-1, 3)
