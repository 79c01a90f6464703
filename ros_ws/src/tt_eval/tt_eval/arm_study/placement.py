"""Placements of an arm, i.e. base, mount of the racket and waiting posture, which the search varies."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from tt_arm.model import ArmModel, UrdfOptions
from tt_arm.reach import reach
from tt_core.constants import FLOOR_Z, TABLE_WIDTH
from tt_core.robots import ArmFile
from tt_core.states import Array, RacketState

BASE_LOW, BASE_HIGH = (-1.3, 0.2, FLOOR_Z, -math.pi), (-0.25, TABLE_WIDTH - 0.2, 0.4, math.pi)  # m, m, m, rad: bases that are drawn
HANDLE = 0.15  # m from the tip to the middle of the blade
MOVES = (0.08, 0.08, 0.08, 0.2)  # m, m, m, rad: standard deviations of a change of the base
TURN = 0.2  # rad, standard deviation of a change of the mount
SHIFT = 0.06  # standard deviation of a change of the waiting posture, as a share of each joint's range
WAITING_DISTANCE = 0.1  # m, distance of the waiting racket behind the middle of the hit window
PLACEMENT_PARTS = ("base", "mount", "waiting")


@dataclass(frozen=True)
class Placement:
    """Placement of an arm: where it stands, how it holds the racket, and where it waits.

    Attributes:
        base: Pose of the root link in `table`: x, y, z (m) and yaw (rad), or x, y, z and roll, pitch, yaw.
        mount: Pose of the racket on the tip, see `ArmModel.from_urdf`; None for the pose of the URDF's own racket.
        waiting: (n,) rad or m, waiting posture. None: the middle of each joint's range, or no posture was found that holds the racket where
            it should wait.
    """

    base: tuple[float, ...]
    mount: tuple[float, ...] | None
    waiting: tuple[float, ...] | None

    def model(self, urdf: str, arm: ArmFile) -> ArmModel:
        """Return the model of an arm in this placement.

        Args:
            urdf: Path of the URDF.
            arm: Its arm file, for tip, limits, and joints and links that are fixed or left out.

        Raises:
            TtError: The arm cannot be used.
        """
        return ArmModel.from_urdf(urdf, arm.tip, self.base, self.mount, self.waiting, UrdfOptions(arm.limits, arm.fixed, arm.left_out))

    @classmethod
    def of(cls, arm: ArmFile) -> Placement:
        """Return the placement in an arm file."""
        return cls(arm.base, arm.mount, arm.waiting)


def draw_placement(start: Placement, urdf: str, arm: ArmFile, kept: tuple[str, ...], rng: np.random.Generator) -> Placement:
    """Draw a placement at random.

    Args:
        start: Placement whose parts in `kept` are not changed.
        urdf: Path of the URDF.
        arm: Its arm file.
        kept: Parts that are kept, of PLACEMENT_PARTS.
        rng: Random numbers.
    """
    made = start
    if "base" not in kept:
        made = replace(made, base=tuple(rng.uniform(BASE_LOW, BASE_HIGH).tolist()))
    if "mount" not in kept:
        made = replace(made, mount=(HANDLE, float(rng.uniform(-0.5 * math.pi, 0.5 * math.pi))))
    if "waiting" not in kept:
        model = replace(made, waiting=None).model(urdf, arm)
        made = replace(made, waiting=ready(model, arm, rng))
    return made


def ready(model: ArmModel, arm: ArmFile, rng: np.random.Generator) -> tuple[float, ...] | None:
    """Find a waiting posture that holds the racket behind the middle of the hit window, with its face towards the opponent.

    Args:
        model: The arm.
        arm: Its arm file, which has the hit window.
        rng: Random numbers for the posture from which the search starts.

    Returns:
        (n,) rad or m; None if no posture was found.
    """
    window = arm.hit_window
    middle = [
        0.5 * (window.x_low + window.x_high) - WAITING_DISTANCE,
        0.5 * (window.y_low + window.y_high),
        0.5 * (window.z_low + window.z_high),
    ]
    racket = RacketState(1.0, np.array(middle), np.zeros(3), 0.0, 1.2)
    found = reach(model, racket, rng.uniform(*model.position_limits.T))
    return tuple(found.q.tolist()) if found.reason is None else None


def changed(one: Placement, limits: Array, kept: tuple[str, ...], rng: np.random.Generator) -> Placement:
    """Return a placement near another one, changed at random.

    Args:
        one: The other one.
        limits: (n, 2) rad or m, position limits of the joints.
        kept: Parts that are kept, of PLACEMENT_PARTS.
        rng: Random numbers.
    """
    made, parts = one, [part for part in PLACEMENT_PARTS if part not in kept and rng.uniform() < 0.6] or [PLACEMENT_PARTS[-1]]
    if "base" in parts:
        moves = np.zeros(len(one.base))
        moves[[0, 1, 2, -1]] = rng.normal(0.0, MOVES)
        made = replace(made, base=tuple((np.array(one.base) + moves).tolist()))
    if "mount" in parts and one.mount is not None:
        made = replace(made, mount=(*one.mount[:-1], one.mount[-1] + float(rng.normal(0.0, TURN))))
    if "waiting" in parts and one.waiting is not None and "waiting" not in kept:
        low, high = limits.T
        moved = np.array(one.waiting) + rng.normal(0.0, SHIFT, len(low)) * (high - low) * (rng.uniform(size=len(low)) < 0.6)
        room = 0.02 * (high - low)
        made = replace(made, waiting=tuple(np.clip(moved, low + room, high - room).tolist()))
    return made
