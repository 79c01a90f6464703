"""Observations of the racket: points of it that touch known places, or that a calibrated camera sees."""

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

REFINED = 3  # pixels, half width of the window in which a corner of the board is refined; the squares must be larger


class BadRows(TtError):
    """Error: a file of observations or cameras cannot be read or does not have the expected content.

    Attributes:
        file: The file.
    """

    def __init__(self, file: Path, why: object) -> None:
        """Keep the file. why: what is wrong with it."""
        super().__init__(f"{file}: {why}")
        self.file = file


class Touch(NamedTuple):
    """Observation: a point of the racket touches a known place.

    Attributes:
        q: (n,) joint positions, rad or m.
        place: (3,) m, the touched place in the frame `table`.
        part: (3,) m, the touching point in the frame `racket`.
    """

    q: Array
    place: Array
    part: Array


class Sighting(NamedTuple):
    """Observation: a camera sees a point of the racket.

    Attributes:
        q: (n,) joint positions, rad or m.
        side: Name of the camera, "left" or "right".
        pixel: (2,) pixels at which the point is seen.
        part: (3,) m, the point in the frame `racket`.
    """

    q: Array
    side: str
    pixel: Array
    part: Array


@dataclass(frozen=True, eq=False)
class PinholeCamera:
    """A calibrated camera: p_camera = rotation p_table + translation.

    Attributes:
        rotation: (3, 3) from the frame `table` to the camera's optical frame.
        translation: (3,) m, origin of `table` in the camera's optical frame.
        matrix: (3, 3) camera matrix, pixels.
        distortion: (5,) distortion coefficients of OpenCV: k1, k2, p1, p2, k3.
    """

    rotation: Array
    translation: Array
    matrix: Array
    distortion: Array

    def pixels(self, points: Array) -> Array:
        """Return the pixels (n, 2) at which the camera sees points (n, 3) m in the frame `table`."""
        turn = Rotation.from_matrix(self.rotation).as_rotvec()
        seen, _ = cv2.projectPoints(points.reshape(-1, 1, 3), turn, self.translation, self.matrix, self.distortion)
        pixels: Array = np.array(seen, dtype=np.float64).reshape(-1, 2)
        return pixels


def read_cameras(file: Path) -> dict[str, PinholeCamera]:
    """Read calibrated cameras from a file that `ros2 run tt_vision calibrate` wrote (cameras.yaml).

    Returns:
        The cameras by name, "left" and "right", as far as the file has them.

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
    """Read touched places from a CSV file.

    Args:
        file: Rows of joint positions (rad or m), the touched place x, y, z (m, in `table`) and the touching point of the racket px, py, pz
            (m, in `racket`).
        joints: Number of joints.

    Raises:
        BadRows: The file cannot be read, or a row is wrong.
    """
    rows = [_numbers(file, row) for row in _rows(file, joints + 6, "joint positions, x, y, z, and the point of the racket px, py, pz")]
    return [Touch(row[:joints], row[joints : joints + 3], row[joints + 3 :]) for row in rows]


def read_sightings(file: Path, joints: int) -> list[Sighting]:
    """Read seen points from a CSV file.

    Args:
        file: Rows of joint positions (rad or m), name of the camera, pixel u, v and the seen point of the racket px, py, pz (m, in
            `racket`).
        joints: Number of joints.

    Raises:
        BadRows: The file cannot be read, or a row is wrong.
    """
    found = []
    for row in _rows(file, joints + 6, "joint positions, camera, u, v, and the point of the racket px, py, pz"):
        values = _numbers(file, row[:joints] + row[joints + 1 :])
        found.append(Sighting(values[:joints], row[joints], values[joints : joints + 2], values[joints + 2 :]))
    return found


def read_board_images(file: Path, joints: int, corners: tuple[int, int], square: float) -> list[list[Sighting]]:
    """Find the corners of a chess board on the racket in images.

    The board is glued on the racket's face, with its centre on the centre of the face and its rows along the x axis of the frame `racket`.

    Args:
        file: CSV file with rows of joint positions (rad or m), name of the camera, and path of the image relative to the file.
        joints: Number of joints.
        corners: Number of inner corners in a row and in a column.
        square: Side of a square, m.

    Returns:
        The corners of each image, row by row. They may begin at any of the board's four corners; `fit.upright` finds out at which.

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
