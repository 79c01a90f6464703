"""What became of one ball, from the contacts of the true world."""

from __future__ import annotations

from dataclasses import dataclass, field

from tt_core.constants import NET_X
from tt_core.states import BallState

from .world import Contact

BEHIND = -1.5  # m in x: past the arm
AFTER_LANDING = 0.1  # s that a returned ball is followed on


@dataclass
class Outcome:
    """launched: the ball at time and place of the launch. contacts: all so far, in order of time."""

    launched: BallState
    contacts: list[Contact] = field(default_factory=list)

    @property
    def hit(self) -> Contact | None:
        """The contact with the racket."""
        return next((c for c in self.contacts if c.surface == "racket"), None)

    @property
    def landing(self) -> Contact | None:
        """What the ball met first after the hit."""
        if self.hit is None:
            return None
        later = self.contacts[self.contacts.index(self.hit) + 1 :]
        return later[0] if later else None

    @property
    def result(self) -> str:
        """What it is as far as the contacts go: missed until hit, then flying until it meets something."""
        if self.hit is None:
            return "missed"
        if self.landing is None:
            return "flying"
        if self.landing.surface == "table":
            return "returned" if self.landing.before.position[0] > NET_X else "own half"
        return {"net": "net", "racket": "second hit"}.get(self.landing.surface, "off the table")

    def over(self, ball: BallState | None, time: float) -> bool:
        """Whether nothing more of interest happens to the ball, which is None when it is gone."""
        if ball is None or (self.hit is None and ball.position[0] < BEHIND):
            return True
        return self.landing is not None and time > self.landing.before.time + AFTER_LANDING
