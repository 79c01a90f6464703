"""What is observed of the racket: points of it that touch known places, or that a camera sees."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import yaml
from scipy.spatial.transform import Rotation
from tt_core.errors import TtError, check_array
from tt_core.states import Array
from tt_vision.rig import SIDES

REFINED = 3  # pixels around a corner of the board, within which it is refined; its squares must be larger


class BadRows(TtError):
    """A file that does not have the rows that it should have."""

    def __init__(self, file: Path, why: object) -> None:
        """Keep the file."""
        super().__init__(f"{file}: {why}")
        self.file = file


class Touch(NamedTuple):
    """A point of the racket touches a known place."""

    q: Array  # (n,) rad or m
    place: Array  # (3,) m in `table`
    part: Array  # (3,) m, the point in the frame of the racket


class Sighting(NamedTuple):
    """A camera sees a point of the racket."""

    q: Array  # (n,) rad or m
    side: str  # name of the camera
    pixel: Array  # (2,)
    part: Array  # (3,) m, the point in the frame of the racket


@dataclass(frozen=True, eq=False)
class PinholeCamera:
    """A calibrated camera.

    Attributes:
        rotation: (3, 3) from `table` to the camera's frame.
        translation: (3,) m.
        matrix: (3, 3) pixels.
        distortion: As in OpenCV.
    """

    rotation: Array
    translation: Array
    matrix: Array
    distortion: Array

    def pixels(self, points: Array) -> Array:
        """Return where points (n, 3) m in `table` are seen, (n, 2)."""
        turn = Rotation.from_matrix(self.rotation).as_rotvec()
        seen, _ = cv2.projectPoints(points.reshape(-1, 1, 3), turn, self.translation, self.matrix, self.distortion)
        pixels: Array = np.array(seen, dtype=np.float64).reshape(-1, 2)
        return pixels


def read_cameras(file: Path) -> dict[str, PinholeCamera]:
    """Read the cameras of a file that `ros2 run tt_vision calibrate` wrote (cameras.yaml), by name.

    Raises:
        BadRows: The file cannot be read, or has no camera.
    """
    try:
        content = yaml.safe_load(file.read_text())
        values = content["/**/camera"]["ros__parameters"] | content["/**/estimate"]["ros__parameters"]
        found = {
            side: PinholeCamera(
                *(check_array(f"{side}.{name}", np.reshape(values[f"{side}.{name}"], shape), shape) for name, shape in _CAMERA.items())
            )
            for side in SIDES
            if f"{side}.rotation" in values
        }
    except (OSError, yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        raise BadRows(file, f"no cameras as calibrate writes them: {error}") from error
    if not found:
        raise BadRows(file, "no camera is in it")
    return found


_CAMERA = {"rotation": (3, 3), "translation": (3,), "matrix": (3, 3), "distortion": (5,)}


def _rows(file: Path, columns: int, what: str) -> list[list[str]]:
    try:
        lines = [line.split("#")[0].strip() for line in file.read_text().splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        raise BadRows(file, error) from error
    rows = [[cell.strip() for cell in line.split(",")] for line in lines if line]
    wrong = next((row for row in rows if len(row) != columns), None)
    if wrong is not None or not rows:
        raise BadRows(file, f"{f'a row has {len(wrong)} columns' if wrong else 'no row'}, wanted {columns}: {what}")
    return rows


def _numbers(file: Path, cells: list[str]) -> Array:
    try:
        return check_array("row", [float(cell) for cell in cells], (len(cells),))
    except ValueError as error:
        raise BadRows(file, error) from error


def read_touches(file: Path, joints: int) -> list[Touch]:
    """Read rows of joint positions, the place touched x, y, z and the touching point of the racket px, py, pz. Raises BadRows."""
    rows = [_numbers(file, row) for row in _rows(file, joints + 6, "joint positions, x, y, z, and the point of the racket px, py, pz")]
    return [Touch(row[:joints], row[joints : joints + 3], row[joints + 3 :]) for row in rows]


def read_sightings(file: Path, joints: int) -> list[Sighting]:
    """Read rows of joint positions, name of the camera, pixel u, v and the point of the racket px, py, pz. Raises BadRows."""
    found = []
    for row in _rows(file, joints + 6, "joint positions, camera, u, v, and the point of the racket px, py, pz"):
        values = _numbers(file, row[:joints] + row[joints + 1 :])
        found.append(Sighting(values[:joints], row[joints], values[joints : joints + 2], values[joints + 2 :]))
    return found


def read_board_images(file: Path, joints: int, corners: tuple[int, int], square: float) -> list[list[Sighting]]:
    """Find a chess board that is glued on the racket's face in images: its middle on that of the face, its rows along the racket's x axis.

    Args:
        file: Rows of joint positions, name of the camera and the image, relative to the file.
        joints: Number of the joints.
        corners: Inner corners in a row and in a column.
        square: m, side of a square.

    Returns:
        The corners of each image, row by row, from any of the four corners of the board on, see `fit.upright`.

    Raises:
        BadRows: A row is wrong, or an image cannot be read or shows no board.
    """
    across, down = corners
    grid = np.array([[x, -y, 0.0] for y in range(down) for x in range(across)])  # images count rows downwards
    parts = square * (grid - grid.mean(axis=0))
    found = []
    for row in _rows(file, joints + 2, "joint positions, camera, image"):
        path = file.parent / row[-1]
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise BadRows(file, f"{path} is no image")
        there, seen = cv2.findChessboardCorners(image, corners)
        if not there:
            raise BadRows(file, f"{path} shows no board of {across} x {down} inner corners")
        seen = cv2.cornerSubPix(image, seen, (REFINED, REFINED), (-1, -1), (cv2.TERM_CRITERIA_EPS, 100, 1e-3))
        pixels = np.asarray(seen, dtype=np.float64).reshape(-1, 2)
        q = _numbers(file, row[:joints])
        found.append([Sighting(q, row[joints], pixel, part) for pixel, part in zip(pixels, parts, strict=True)])
    return found
