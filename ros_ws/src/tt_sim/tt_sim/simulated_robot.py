"""Arm and balls together, tick by tick: what commands do to joints, racket and balls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from tt_arm.joints import Joints
from tt_core.physics import Physics
from tt_core.states import Array, BallState

from .world.arm_record import ArmRecord
from .world.outcome import Outcome
from .world.plant import Plant
from .world.true_ball import Contact, RacketMotion, World

LONGEST = 10.0  # s after the launch, when a ball is over wherever it is


@dataclass(frozen=True, slots=True, eq=False)
class Tick:
    """What is true at its end. contacts: of the last launched ball during it. ball: it, None when it does not fly. ended: what became
    of the balls that this tick ended."""

    joints: Joints
    racket: RacketMotion
    contacts: list[Contact]
    ball: BallState | None
    ended: tuple[Outcome, ...]


class SimulatedRobot:
    """The simulated arm from `joints` on, and the balls in flight, which do not meet each other. outcome: of the last launched one, if any.
    tick: s."""

    def __init__(self, physics: Physics, plant: Plant, joints: Joints, tick: float) -> None:
        self.plant, self.tick, self.joints = plant, tick, joints
        self.outcome: Outcome | None = None
        self._physics = physics
        self._racket_row = plant.racket(joints).row
        self._flights: list[tuple[World, Outcome]] = []

    def launch(self, ball: BallState, physics: Physics | None = None) -> Outcome:
        """The ball flies from its own time on; what becomes of it is filled in tick by tick. physics: for it alone, if not that of all."""
        self.outcome = Outcome(ball)
        world = World(physics or self._physics)
        world.ball = ball
        self._flights.append((world, self.outcome))
        return self.outcome

    def advance(self, command: Array) -> Tick:
        """One tick under the command (7,) rad/s."""
        self.joints = self.plant.advance(self.joints, command, self.tick)
        racket = self.plant.racket(self.joints)
        before, self._racket_row = self._racket_row, racket.row
        rackets = np.array([before, self._racket_row])
        now = self.joints.time
        contacts: list[Contact] = []
        ball, ended = None, []
        for world, outcome in self._flights:
            if now < outcome.launched.time:
                ball = None
                continue
            contacts = world.advance(now, rackets, self.tick)
            outcome.contacts += contacts
            ball = world.ball
            if outcome.over(ball, now) or now - outcome.launched.time > LONGEST:
                ended.append(outcome)
        self._flights = [flight for flight in self._flights if not any(flight[1] is outcome for outcome in ended)]
        return Tick(self.joints, racket, contacts, ball, tuple(ended))


def warm(plant: Plant) -> None:
    """Loads the kernels, so that no tick waits for them."""
    hardware = SimulatedRobot(Physics.liu(), plant, Joints(0.0, plant.model.waiting, np.zeros(7)), 0.002)
    hardware.launch(BallState.from_vector(0.0, np.array([2.6, 0.76, 0.4, -5.0, 0.0, 1.0, 0.0, -300.0, 0.0])))
    ArmRecord(plant.model, hardware.joints)
    for _ in range(300):  # beyond the bounce on the table
        hardware.advance(np.zeros(7))
