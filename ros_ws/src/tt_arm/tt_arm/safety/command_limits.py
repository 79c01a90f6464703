"""Kernels that limit a joint velocity command: speed, distance to brake before the position limit, and change since the last command."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from tt_core.states import Array

from ..joints import JointBounds

NOT_CUT, CUT_BY_SPEED, CUT_BY_POSITION, CUT_BY_ACCELERATION = range(4)  # whether and by which limit a command was cut
SAME_COMMAND = 1e-9  # rad/s; a command that differs from the wanted one by less than this counts as not cut


@njit(cache=True)
def speed_for_room(room: float, hold: float, braking: float) -> float:
    """Return the largest speed from which a joint comes to rest within a given distance.

    Args:
        room: rad, distance to the position limit.
        hold: s, time for which the joint keeps its speed before it brakes.
        braking: rad/s^2, deceleration with which it brakes.

    Returns:
        rad/s; 0 if `room` is negative.
    """
    return math.sqrt((braking * hold) ** 2 + 2.0 * braking * max(0.0, room)) - braking * hold


@njit(cache=True)
def clip_to_room(q: Array, hold: float, limits: JointBounds, braking: Array, command: Array) -> None:
    """Limit a velocity command in place to speeds from which the joints can brake before their position limits.

    Args:
        q: (n,) rad, measured joint positions.
        hold: s, time for which the command may last before the joints brake.
        limits: (n,) limits of the joints, of which the positions are used.
        braking: (n,) rad/s^2, deceleration with which each joint brakes.
        command: (n,) rad/s, changed in place.
    """
    for i in range(len(q)):
        down, up = speed_for_room(q[i] - limits[i].low, hold, braking[i]), speed_for_room(limits[i].high - q[i], hold, braking[i])
        command[i] = min(max(command[i], -down), up)


@njit(cache=True)
def limit_command(
    q: Array, wanted: Array, last: Array, passed: float, hold: float, limits: JointBounds, braking: Array, allowed: Array
) -> int:
    """Compute the velocity command that is nearest to a wanted one within the limits.

    If the distance needed to brake and the limit of the command's change contradict each other, the distance to brake is kept.

    Args:
        q: (n,) rad, measured joint positions.
        wanted: (n,) rad/s, wanted command.
        last: (n,) rad/s, last command.
        passed: s, time since the last command.
        hold: s, time for which the command may last before the joints brake.
        limits: (n,) position limits with the margin to keep, speed limits, and accelerations by which the command may change.
        braking: (n,) rad/s^2, deceleration with which each joint brakes.
        allowed: (n,) rad/s, output: filled with the permitted command.

    Returns:
        NOT_CUT if the wanted command is permitted. Otherwise the limit that changed it: CUT_BY_SPEED if the speed limit changed that of any
        joint, else CUT_BY_POSITION if the position limit did, else CUT_BY_ACCELERATION.
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
        cut = cut or abs(allowed[i] - wanted[i]) > SAME_COMMAND
    if not cut:
        return NOT_CUT
    return CUT_BY_SPEED if faster else CUT_BY_POSITION if further else CUT_BY_ACCELERATION


def cut_joints(allowed: Array, wanted: Array) -> Array:
    """Return an array (n,) that tells for each joint whether its permitted command differs from the wanted one; both (n,) rad/s."""
    return np.asarray(np.abs(allowed - wanted) > SAME_COMMAND)
