"""Actions that a user of the live view can ask for by its buttons."""

from __future__ import annotations

from dataclasses import dataclass

from tt_core.states import ReturnGoal


@dataclass(frozen=True)
class Launch:
    """Launch one ball.

    Attributes:
        shot: Kind of the ball (top, back, left or right spin) and scale of the launcher (1 to 10), separated by a space, e.g. "top 3".
    """

    shot: str


@dataclass(frozen=True)
class SetRate:
    """Launch balls at a rate.

    Attributes:
        shot: Kind and scale of the balls, as in Launch, e.g. "top 3".
        rate: Balls per minute; 0 to launch balls on request only.
    """

    shot: str
    rate: float


@dataclass(frozen=True, eq=False)
class SetGoal:
    """Change the goal of the returns.

    Attributes:
        goal: Landing place, flight time and spin that returned balls are to have.
    """

    goal: ReturnGoal


@dataclass(frozen=True)
class Enable:
    """Enable the arm, so that it may move."""


@dataclass(frozen=True)
class Stop:
    """Stop the arm until it is enabled again."""


@dataclass(frozen=True)
class Pause:
    """Pause or resume simulated time.

    Attributes:
        on: True to pause, False to resume.
    """

    on: bool


@dataclass(frozen=True)
class Step:
    """Advance simulated time by one step while it is paused."""


Action = Launch | SetRate | SetGoal | Enable | Stop | Pause | Step
