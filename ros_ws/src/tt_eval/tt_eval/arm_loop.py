"""Controller and simulated arm, tick by tick."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from tt_arm.control import ArmControl, ControlStep
from tt_arm.joints import Joints
from tt_core.states import Array
from tt_sim.world.plant import Plant


class ArmTick(NamedTuple):
    """The arm at the beginning of a tick.

    Attributes:
        joints: The true ones.
        step: What the controller makes of the measured ones; its command holds for this tick.
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
    """Let the controller move the arm, for as long as the caller iterates.

    The caller may give strokes to the controller after each tick's step; they count from the next step on.

    Args:
        control: The controller.
        plant: The arm.
        start: Where it starts; the first step is made there.
        tick: s.
        rng: Of the encoders.
        advance: Obeys a command (n,) rad/s for one tick and returns the joints; None: only the arm moves.

    Yields:
        Joints and step of each tick.
    """
    joints = start
    while True:
        step = control.step(plant.measured(joints, rng))
        yield ArmTick(joints, step)
        joints = plant.advance(joints, step.command, tick) if advance is None else advance(step.command)
