"""Fit the poses of the arm's base and of its racket to observations of points of the racket."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.optimize import least_squares
from tt_arm.model import ArmModel
from tt_core.errors import TtError
from tt_core.states import Array

from .observations import PinholeCamera, Sighting, Touch

TOUCH_ERROR, SIGHTING_ERROR = 0.5e-3, 0.5  # m and pixels, errors of a touched place and of a seen point that have the same weight
LEAST = 1e-5  # ratio of the smallest to the largest singular value, below which the observations do not determine everything
SCALE = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])  # m, rad: a turn by 0.5 rad moves the racket roughly as far as a shift by 1 m
FITTED_PARTS = ("base", "mount")  # what can be fitted: the pose of the arm's base, and how the racket is mounted on the arm


class NotDetermined(TtError):
    """Error: the observations do not determine all the numbers that are sought.

    Attributes:
        open: How many of the sought numbers they do not determine.
    """

    def __init__(self, count: int, sought: int) -> None:
        """Keep how many of the sought numbers are not determined, `count` of `sought`."""
        super().__init__(
            f"the observations leave {count} of {sought} numbers open: "
            "observe other postures or other points of the racket, or keep what is known"
        )
        self.open = count


class UnknownCamera(TtError):
    """Error: a camera that has seen the racket is none of those whose calibration is given.

    Attributes:
        side: Name of the camera.
    """

    def __init__(self, side: str, known: Sequence[str]) -> None:
        """Keep the name of the camera. known: the names of the calibrated cameras."""
        super().__init__(f"camera {side!r} is none of {', '.join(map(repr, known)) or 'those calibrated, for there are none'}")
        self.side = side


@dataclass(frozen=True, eq=False)
class Located:
    """Result of the fit: corrections of the assumed poses of base and racket, with residuals and standard deviations.

    Attributes:
        base: Correction of the base in the frame `table`: the new pose is `base` times the assumed pose.
        mount: Correction of the racket's mount: the new mount is the assumed mount times `mount`.
        touched: (m,) m, distance of each touched place from the touching point of the racket after the fit.
        seen: (k,) pixels, distance of each seen pixel from the seen point of the racket after the fit.
        sigma: For each of FITTED_PARTS that was fitted, (6,) standard deviations of x, y, z (m) and of the rotations about them (rad).
    """

    base: pin.SE3
    mount: pin.SE3
    touched: Array
    seen: Array
    sigma: dict[str, Array]


def fit_placement(
    arm: ArmModel,
    touches: Sequence[Touch],
    sightings: Sequence[Sighting],
    cameras: Mapping[str, PinholeCamera],
    kept: Sequence[str] = (),
) -> Located:
    """Find the corrections of base and mount with which the arm fits the observations best (least squares).

    Args:
        arm: The arm at its assumed place, which may be wrong by up to 0.3 m and 0.5 rad.
        touches: Touched places.
        sightings: Seen points.
        cameras: Calibrated cameras by name.
        kept: Those of FITTED_PARTS that are known already and are not fitted.

    Raises:
        NotDetermined: The observations do not determine all that is fitted.
        UnknownCamera: A sighting is of a camera that is not in `cameras`.
    """
    for one in sightings:
        if one.side not in cameras:
            raise UnknownCamera(one.side, tuple(cameras))
    sought = [part for part in FITTED_PARTS if part not in kept]
    observed: list[Touch | Sighting] = [*touches, *sightings]
    poses = [pin.SE3(rotation, position) for position, rotation in (arm.racket(one.q) for one in observed)]

    def corrections(values: Array) -> dict[str, pin.SE3]:
        found = dict.fromkeys(FITTED_PARTS, pin.SE3.Identity())
        for i, part in enumerate(sought):
            move = SCALE * values[6 * i : 6 * i + 6]
            found[part] = pin.SE3(pin.exp3(move[3:]), move[:3])
        return found

    def misses(values: Array) -> tuple[Array, Array]:
        """Return the errors of the touched places, (m, 3) m, and of the seen points, (k, 2) pixels, with given corrections."""
        moved = corrections(values)
        placed = [moved["base"] * pose * moved["mount"] for pose in poses]
        points = np.array([pose.act(np.array(one.part)) for pose, one in zip(placed, observed, strict=True)]).reshape(-1, 3)
        m = len(touches)
        off = points[:m] - np.array([one.place for one in touches]).reshape(-1, 3)
        pixels = np.zeros((len(sightings), 2))
        for side, camera in cameras.items():
            rows = [i for i, one in enumerate(sightings) if one.side == side]
            if rows:
                pixels[rows] = camera.pixels(points[m:][rows]) - np.array([sightings[i].pixel for i in rows])
        return off, pixels

    def residuals(values: Array) -> Array:
        off, pixels = misses(values)
        return np.concatenate([off.ravel() / TOUCH_ERROR, pixels.ravel() / SIGHTING_ERROR])

    count = 6 * len(sought)
    if len(residuals(np.zeros(count))) < count or not count:
        raise NotDetermined(max(1, count - 3 * len(touches) - 2 * len(sightings)), count)
    found = least_squares(residuals, np.zeros(count), x_scale="jac")
    _, singular, directions = np.linalg.svd(found.jac, full_matrices=False)
    if singular[-1] < LEAST * singular[0]:
        raise NotDetermined(int((singular < LEAST * singular[0]).sum()), count)
    free = max(1, len(found.fun) - count)
    covariance = (directions.T / singular**2) @ directions * (2.0 * found.cost / free)
    sigma = np.tile(SCALE, len(sought)) * np.sqrt(np.diag(covariance))
    off, pixels = misses(found.x)
    moved = corrections(found.x)
    by_part = {part: sigma[6 * i : 6 * i + 6] for i, part in enumerate(sought)}
    return Located(moved["base"], moved["mount"], np.linalg.norm(off, axis=1), np.linalg.norm(pixels, axis=1), by_part)


def upright(arm: ArmModel, board: Sequence[Sighting], cameras: Mapping[str, PinholeCamera]) -> list[Sighting]:
    """Assign the corners of a chess board that were found in an image to the corners of the board on the racket.

    Corners are found row by row, but from any of the board's four corners on. Of the four possible orders, the one is taken whose pixels
    are nearest to where the camera would see the board if the arm stood at its assumed place.

    Args:
        arm: The arm at its assumed place.
        board: The corners of one image, as found.
        cameras: Calibrated cameras by name.

    Returns:
        The corners of the board on the racket, with the pixels of the right order.

    Raises:
        UnknownCamera: The camera is not in `cameras`.
    """
    side, parts = board[0].side, np.array([one.part for one in board])
    if side not in cameras:
        raise UnknownCamera(side, tuple(cameras))
    position, rotation = arm.racket(board[0].q)
    expected = cameras[side].pixels(parts @ rotation.T + position)
    rows = np.array([one.pixel for one in board]).reshape(len(np.unique(parts[:, 1])), -1, 2)
    orders = [order.reshape(-1, 2) for order in (rows, rows[::-1], rows[:, ::-1], rows[::-1, ::-1])]
    middle = expected.mean(axis=0) - rows.mean(axis=(0, 1))  # a common shift does not count, only how the board is turned
    nearest = min(orders, key=lambda order: float(np.linalg.norm(order + middle - expected)))
    return [one._replace(pixel=pixel) for one, pixel in zip(board, nearest, strict=True)]
