"""Arm and ball together, tick by tick: what commands do to joints, racket and ball."""

from __future__ import annotations

from dataclasses import dataclass

from tt_arm.swing import Joints
from tt_core.physics import Physics
from tt_core.states import Array, BallState

from .outcome import Outcome
from .plant import Plant
from .world import Contact, RacketMotion, World


@dataclass(frozen=True, slots=True, eq=False)
class Tick:
    """What is true at its end. contacts: of the ball during it. ball: None when none flies. over: whether this tick ended the ball."""

    joints: Joints
    racket: RacketMotion
    contacts: list[Contact]
    ball: BallState | None
    over: bool


class Hardware:
    """The simulated arm from `joints` on, and at most one ball, of which `outcome` tells. tick: s."""

    def __init__(self, physics: Physics, plant: Plant, joints: Joints, tick: float) -> None:
        self.plant, self.tick, self.joints = plant, tick, joints
        self.outcome: Outcome | None = None
        self._world = World(physics)
        self._racket = plant.racket(joints)
        self._next: BallState | None = None

    def launch(self, ball: BallState) -> None:
        """The ball flies from its own time on; one in play before is gone."""
        self.outcome, self._next, self._world.ball = Outcome(ball), ball, None

    def advance(self, command: Array) -> Tick:
        """One tick under the command (7,) rad/s."""
        self.joints = self.plant.advance(self.joints, command, self.tick)
        before, self._racket = self._racket, self.plant.racket(self.joints)
        now = self.joints.time
        if self._next is not None and now >= self._next.time:
            self._world.ball, self._next = self._next, None
        if self.outcome is None or self._world.ball is None:
            return Tick(self.joints, self._racket, [], None, False)
        contacts = self._world.advance(now, (before, self._racket), self.tick)
        self.outcome.contacts += contacts
        ball, over = self._world.ball, self.outcome.over(self._world.ball, now)
        if over:
            self._world.ball = None
        return Tick(self.joints, self._racket, contacts, ball, over)
