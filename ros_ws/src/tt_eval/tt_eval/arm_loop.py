"""Simulation of controller and arm in ticks, steps of fixed duration."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from tt_arm.control import ArmControl, ControlStep
from tt_arm.joints import Joints
from tt_core.states import Array
from tt_sim.world.plant import Plant


class ArmTick(NamedTuple):
    """State of the arm at the beginning of a tick, one step of the simulation, and the controller's reaction.

    Attributes:
        joints: True state of the joints.
        step: Result of the controller for the measured state. Its command is followed during this tick.
    """

    joints: Joints
    step: ControlStep


def arm_ticks(
    control: ArmControl,
    plant: Plant,
    start: Joints,
    tick: float,
    rng: np.random.Generator,
    advance: Callable[[Array], Joints] | None = None,
) -> Iterator[ArmTick]:
    """Simulate the arm under its controller, for as long as the caller iterates.

    The caller may give strokes to the controller after each tick. They take effect from the next tick on.

    Args:
        control: The controller.
        plant: The simulated arm.
        start: State of the joints at the first tick.
        tick: s, duration of a tick.
        rng: Random numbers for the encoders.
        advance: Function that follows a command (n,) in rad/s for one tick and returns the joints; None: only the arm is simulated.

    Yields:
        State and reaction for each tick.
    """
    joints = start
    while True:
        step = control.step(plant.measured(joints, rng))
        yield ArmTick(joints, step)
        joints = plant.advance(joints, step.command, tick) if advance is None else advance(step.command)
