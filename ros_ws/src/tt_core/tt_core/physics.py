"""One set of models: what the robot believes, or what is true in the simulator."""

from __future__ import annotations

from dataclasses import dataclass, field

from .bounce import RacketRebound, TableRebound
from .constants import BALL_RADIUS
from .errors import check_range
from .flight import Aerodynamics


@dataclass(frozen=True)
class Physics:
    """air, table, racket: the models. contact_height: m, from a surface to the ball's centre in contact; the dissertation uses 0."""

    air: Aerodynamics = field(default_factory=Aerodynamics.liu)
    table: TableRebound = field(default_factory=TableRebound.liu)
    racket: RacketRebound = field(default_factory=RacketRebound.liu)
    contact_height: float = BALL_RADIUS

    def __post_init__(self) -> None:
        check_range("contact_height", self.contact_height, 0.0, 0.1)

    @classmethod
    def liu(cls, contact_height: float = BALL_RADIUS) -> Physics:
        """All three models of the dissertation."""
        return cls(Aerodynamics.liu(), TableRebound.liu(), RacketRebound.liu(), contact_height)

    @classmethod
    def measured(cls, contact_height: float = BALL_RADIUS) -> Physics:
        """All three models as measured on real balls."""
        return cls(Aerodynamics.measured(), TableRebound.measured(), RacketRebound.measured(), contact_height)
