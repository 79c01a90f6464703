"""Simulation of arm and balls together in ticks, steps of fixed duration: what commands do to joints, racket and balls."""

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

LONGEST_RALLY = 10.0  # s after the launch, when a ball is over wherever it is


@dataclass(frozen=True, slots=True, eq=False)
class Tick:
    """True state at the end of a tick, one step of the simulated robot.

    Attributes:
        joints: Joints of the arm.
        racket: Racket on the arm.
        contacts: Contacts of the last launched ball during the tick.
        ball: The last launched ball; None if it does not fly.
        ended: Results of the balls that ended in this tick.
    """

    joints: Joints
    racket: RacketMotion
    contacts: list[Contact]
    ball: BallState | None
    ended: tuple[Outcome, ...]


class SimulatedRobot:
    """The simulated arm and the balls in flight. The balls do not touch each other.

    Attributes:
        plant: The arm.
        tick: s, duration of a tick, one step.
        joints: State of the joints now.
        outcome: Flight of the last launched ball so far; None before the first.
    """

    def __init__(self, physics: Physics, plant: Plant, joints: Joints, tick: float) -> None:
        """Start without a ball.

        Args:
            physics: True physics of balls that are launched without a physics of their own.
            plant: The arm.
            joints: State of the joints at the start.
            tick: s, duration of a tick.
        """
        self.plant, self.tick, self.joints = plant, tick, joints
        self.outcome: Outcome | None = None
        self._physics = physics
        self._racket_row = plant.racket(joints).row
        self._flights: list[tuple[World, Outcome]] = []

    def launch(self, ball: BallState, physics: Physics | None = None) -> Outcome:
        """Add a ball.

        Args:
            ball: The ball at its launch. It flies from its own time on.
            physics: True physics of this ball; None for that of all balls.

        Returns:
            The record of its flight, to which each tick adds contacts.
        """
        self.outcome = Outcome(ball)
        world = World(physics or self._physics)
        world.ball = ball
        self._flights.append((world, self.outcome))
        return self.outcome

    def advance(self, command: Array) -> Tick:
        """Move arm and balls by one tick.

        Args:
            command: (n,) rad/s, joint velocities.
        """
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
            if outcome.over(ball, now) or now - outcome.launched.time > LONGEST_RALLY:
                ended.append(outcome)
        self._flights = [(world, flown) for world, flown in self._flights if not any(flown is outcome for outcome in ended)]
        return Tick(self.joints, racket, contacts, ball, tuple(ended))


def warm(plant: Plant) -> None:
    """Load the compiled functions by a simulated ball, so that no tick has to wait for them."""
    robot = SimulatedRobot(Physics.liu(), plant, Joints.at_rest(0.0, plant.model.waiting), 0.002)
    robot.launch(BallState.from_vector(0.0, np.array([2.6, 0.76, 0.4, -5.0, 0.0, 1.0, 0.0, -300.0, 0.0])))
    ArmRecord(plant.model, robot.joints)
    for _ in range(300):  # beyond the bounce on the table
        robot.advance(np.zeros(len(robot.joints.q)))
