"""Kernels that cut a command to what a joint may do: speed, room to brake before its position limit, and change since the last command."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from tt_core.states import Array

from ..joints import JointBounds

UNCUT, SPEED, POSITION, ACCELERATION = range(4)  # why a command was cut
SAME = 1e-9  # rad/s, by which a command may differ from the wanted one without being cut


@njit(cache=True)
def speed_for_room(room: float, hold: float, braking: float) -> float:
    """Return the speed (rad/s) that a joint may have for `hold` (s) and then brake from at `braking` (rad/s^2) within `room` (rad)."""
    return math.sqrt((braking * hold) ** 2 + 2.0 * braking * max(0.0, room)) - braking * hold


@njit(cache=True)
def clip_to_room(q: Array, hold: float, limits: JointBounds, braking: Array, command: Array) -> None:
    """Cut a command (n,) rad/s, in place, to what can brake before the position limits; see `limit_command`."""
    for i in range(len(q)):
        down, up = speed_for_room(q[i] - limits[i].low, hold, braking[i]), speed_for_room(limits[i].high - q[i], hold, braking[i])
        command[i] = min(max(command[i], -down), up)


@njit(cache=True)
def limit_command(
    q: Array, wanted: Array, last: Array, passed: float, hold: float, limits: JointBounds, braking: Array, allowed: Array
) -> int:
    """Fill the command that may leave. Room to brake comes before smoothness.

    Args:
        q: (n,) rad, as measured.
        wanted: (n,) rad/s.
        last: (n,) rad/s, the last command.
        passed: s, since the last command.
        hold: s, for which the command may last, before the joints brake.
        limits: Positions with the margin kept, speeds, and accelerations at which commands may change.
        braking: (n,) rad/s^2, at which each joint brakes.
        allowed: (n,) rad/s; filled.

    Returns:
        UNCUT, SPEED, POSITION or ACCELERATION: the first limit that makes any joint's command another one.
    """
    faster, further, cut = False, False, False
    for i in range(len(q)):
        speed, step = limits[i].speed, limits[i].acceleration * passed
        down, up = speed_for_room(q[i] - limits[i].low, hold, braking[i]), speed_for_room(limits[i].high - q[i], hold, braking[i])
        slow = min(max(wanted[i], -speed), speed)
        within = min(max(slow, -down), up)
        change = min(max(within - last[i], -step), step)
        allowed[i] = min(max(last[i] + change, max(-down, -speed)), min(up, speed))
        faster, further = faster or slow != wanted[i], further or within != wanted[i]
        cut = cut or abs(allowed[i] - wanted[i]) > SAME
    if not cut:
        return UNCUT
    return SPEED if faster else POSITION if further else ACCELERATION


def cut_joints(allowed: Array, wanted: Array) -> Array:
    """Return for each joint (n,) whether its command was cut."""
    return np.asarray(np.abs(allowed - wanted) > SAME)
