"""Checks at the start of the arm node: whether the arm can play from its base with its mount, and whether its guard passes its swings."""

from __future__ import annotations

from enum import Enum

import numpy as np
from tt_core.errors import TtError
from tt_core.states import RacketState

from .joints import Joints
from .model import ArmModel
from .reach import reach
from .safety.clearance import OBSTACLES, clearance
from .safety.guard import GuardParams
from .swing import SwingLimits, plan

STRIKE_TIME = 1.0  # s from the start to the strike; enough for every stroke that is within reach
NEEDED = 0.5  # share of the strokes that must be possible; with base, mount and waiting posture of the PA10's arm file all of them are


class StartupFailure(Enum):
    """Codes of failures: why an arm cannot play, or why its parameters contradict each other."""

    WAITING_TOO_NEAR = "the waiting posture {waiting} is {distance:.3f} m from {obstacle}, {bound:g} m wanted"
    TOO_FEW_STROKES = (
        "base = ({x:g}, {y:g}, {z:g}) with this mount makes {made} of {tried} strokes, {needed:.0f} needed: {reason}; "
        "the furthest is {far:.2f} m from the base, the racket comes {length:.2f} m far"
    )
    GUARD_LIMIT = (
        "the guard would cut what swings use: for joint {joint} it allows a {quantity} of {allowed:g} {unit}, swings use {used:g} {unit}; "
        "see the parameters of guard and swing"
    )
    GUARD_CLEARANCE = (
        "the guard would stop what swings use: it keeps {kept:g} m from table, floor and arm, swings come within {used:g} m; "
        "see guard.clearance and swing.clearance"
    )


class StartupError(TtError):
    """The arm cannot play, or its limits contradict each other; its failure has a code of StartupFailure."""


def typical_strokes() -> list[RacketState]:
    """Return typical strokes (racket states) all over the window in which balls are hit, to test whether an arm can make them.

    The positions are from the dissertation's Section 4.5.1, and the velocity is the mean of those printed there.
    """
    velocity = np.array([1.2, 0.0, 1.3])
    places = [(x, y, z) for x in (-0.25, -0.05) for y in (0.45, 0.76, 1.07) for z in (0.2, 0.4)]
    return [RacketState(STRIKE_TIME, np.array(place), velocity, 0.0, 1.2) for place in places]


def check_feasible(model: ArmModel, limits: SwingLimits) -> None:
    """Check that the waiting posture touches nothing, and that the arm can make enough of the typical strokes.

    Args:
        model: The arm.
        limits: Limits that swings must keep.

    Raises:
        StartupError: The waiting posture is too near to an obstacle, or the share of possible strokes is less than NEEDED.
    """
    left, what = clearance(model.waiting, model.bodies)
    if left < limits.clearance:
        values = {"waiting": model.waiting.tolist(), "distance": left, "obstacle": OBSTACLES[what], "bound": limits.clearance}
        raise StartupError(StartupFailure.WAITING_TOO_NEAR, **values)
    start, tried = Joints.at_rest(0.0, model.waiting), typical_strokes()
    reasons = [plan(model, start, reach(model, racket, model.waiting), STRIKE_TIME, limits).reason for racket in tried]
    made = sum(reason is None for reason in reasons)
    if made < NEEDED * len(tried):
        x, y, z = model.base.translation
        reached = model.atlas.faces[:3].T - model.base.translation
        raise StartupError(
            StartupFailure.TOO_FEW_STROKES,
            x=x, y=y, z=z, made=made, tried=len(tried), needed=NEEDED * len(tried),
            reason=next(reason for reason in reasons if reason is not None),
            far=max(float(np.linalg.norm(racket.position - model.base.translation)) for racket in tried),
            length=float(np.linalg.norm(reached, axis=1).max()),
        )  # fmt: skip


def check_guard(model: ArmModel, limits: SwingLimits, guard: GuardParams) -> None:
    """Check that the guard, the last check of each command, permits everything that a swing may use.

    Args:
        model: The arm.
        limits: Limits that swings must keep.
        guard: Limits of the guard.

    Raises:
        StartupError: A limit of the guard is narrower than that of swings.
    """
    allowed, used = guard.of_joints(model), limits.of_joints(model)
    for i, (joint, unit) in enumerate(zip(model.names, used.units, strict=True)):
        quantities = (
            ("speed", f"{unit}/s", allowed.speed[i], used.speed[i]),
            ("change of the command", f"{unit}/s^2", allowed.acceleration[i], used.acceleration[i]),
            ("position", unit, allowed.position[i, 1], used.position[i, 1]),
            ("position (downwards)", unit, -allowed.position[i, 0], -used.position[i, 0]),
        )
        for quantity, quantity_unit, bound, value in quantities:
            if value > bound:
                values = {"quantity": quantity, "unit": quantity_unit, "allowed": float(bound), "used": float(value)}
                raise StartupError(StartupFailure.GUARD_LIMIT, joint=joint, **values)
    if guard.clearance > limits.clearance:
        raise StartupError(StartupFailure.GUARD_CLEARANCE, kept=guard.clearance, used=limits.clearance)
