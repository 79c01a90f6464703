"""Fit the poses of base and racket to observations."""

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

TOUCHED, SEEN = 0.5e-3, 0.5  # m, pixels: errors that count the same, of a touched place and of a seen point
LEAST = 1e-5  # smallest singular value over the largest, below which something is not determined
SCALE = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])  # m, rad: a turn of 0.5 rad moves the racket as far as 1 m does, roughly
PARTS = ("base", "mount")


class NotDetermined(TtError):
    """Observations that leave something open.

    Attributes:
        open: How many of the sought numbers.
    """

    def __init__(self, count: int, sought: int) -> None:
        """Keep the number."""
        super().__init__(
            f"the observations leave {count} of {sought} numbers open: "
            "observe other postures or other points of the racket, or keep what is known"
        )
        self.open = count


class UnknownCamera(TtError):
    """A sighting of a camera that is not calibrated."""

    def __init__(self, side: str, known: Sequence[str]) -> None:
        """Keep the name."""
        super().__init__(f"camera {side!r} is none of {', '.join(map(repr, known)) or 'those calibrated, for there are none'}")
        self.side = side


@dataclass(frozen=True, eq=False)
class Located:
    """Where base and racket are.

    Attributes:
        base: Correction of the base: table from table, applied on the left of the base as it was believed.
        mount: Correction of the racket: applied on the right of the mount as it was believed.
        touched: (m,) m, distances of the touched places from where the racket is by the fit.
        seen: (k,) pixels, the same of the seen points.
        sigma: Standard deviation of each of x, y, z (m) and the turns about them (rad), by PARTS; only of what was fitted.
    """

    base: pin.SE3
    mount: pin.SE3
    touched: Array
    seen: Array
    sigma: dict[str, Array]


def fit(
    arm: ArmModel,
    touches: Sequence[Touch],
    sightings: Sequence[Sighting],
    cameras: Mapping[str, PinholeCamera],
    kept: Sequence[str] = (),
) -> Located:
    """Find corrections of base and mount that explain the observations best.

    Args:
        arm: As it is believed to stand; within 0.3 m and 0.5 rad of the truth.
        touches: Touched places.
        sightings: Seen points.
        cameras: By name.
        kept: Of PARTS, what is known already.

    Raises:
        NotDetermined: The observations leave something open.
        UnknownCamera: A sighting is of a camera that is not given.
    """
    for one in sightings:
        if one.side not in cameras:
            raise UnknownCamera(one.side, tuple(cameras))
    sought = [part for part in PARTS if part not in kept]
    observed: list[Touch | Sighting] = [*touches, *sightings]
    poses = [pin.SE3(rotation, position) for position, rotation in (arm.racket(one.q) for one in observed)]

    def corrections(values: Array) -> dict[str, pin.SE3]:
        found = dict.fromkeys(PARTS, pin.SE3.Identity())
        for i, part in enumerate(sought):
            move = SCALE * values[6 * i : 6 * i + 6]
            found[part] = pin.SE3(pin.exp3(move[3:]), move[:3])
        return found

    def misses(values: Array) -> tuple[Array, Array]:
        """Return (m, 3) m and (k, 2) pixels."""
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
        return np.concatenate([off.ravel() / TOUCHED, pixels.ravel() / SEEN])

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
    """Return the corners of a board on the racket in the order in which they are seen nearest to where the racket is believed to be.

    Args:
        arm: As it is believed to stand.
        board: Corners of one image, row by row, from any of its four corners on.
        cameras: By name.

    Raises:
        UnknownCamera: The camera is not given.
    """
    side, parts = board[0].side, np.array([one.part for one in board])
    if side not in cameras:
        raise UnknownCamera(side, tuple(cameras))
    position, rotation = arm.racket(board[0].q)
    expected = cameras[side].pixels(parts @ rotation.T + position)
    rows = np.array([one.pixel for one in board]).reshape(len(np.unique(parts[:, 1])), -1, 2)
    orders = [order.reshape(-1, 2) for order in (rows, rows[::-1], rows[:, ::-1], rows[::-1, ::-1])]
    middle = expected.mean(axis=0) - rows.mean(axis=(0, 1))  # what counts is the way that the board is turned
    nearest = min(orders, key=lambda order: float(np.linalg.norm(order + middle - expected)))
    return [one._replace(pixel=pixel) for one, pixel in zip(board, nearest, strict=True)]
