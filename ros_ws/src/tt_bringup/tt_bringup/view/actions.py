"""What a user of the view can ask for."""

from __future__ import annotations

from dataclasses import dataclass

from tt_core.states import ReturnGoal


@dataclass(frozen=True)
class Launch:
    """Launch a ball of a kind and a scale, e.g. "top 3"."""

    shot: str


@dataclass(frozen=True)
class SetRate:
    """Launch so many balls a minute; 0: on request only. shot: kind and scale of the balls."""

    shot: str
    rate: float


@dataclass(frozen=True, eq=False)
class SetGoal:
    """Ask for another return."""

    goal: ReturnGoal


@dataclass(frozen=True)
class Enable:
    """Let the arm move."""


@dataclass(frozen=True)
class Stop:
    """Stop the arm until it is enabled again."""


@dataclass(frozen=True)
class Pause:
    """Let simulated time stand still, or go on."""

    on: bool


@dataclass(frozen=True)
class Step:
    """Let a step of simulated time pass."""


Action = Launch | SetRate | SetGoal | Enable | Stop | Pause | Step
