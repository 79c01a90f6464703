"""The true coefficients, drawn at random in two levels: those of a session about its world's, those of a ball about its session's.

What is the same in a session, such as rubber, table and the air of a hall, can be learnt; what differs from ball to ball cannot.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from tt_core.factors import FACTORS, multiplied
from tt_core.params import check, param
from tt_core.physics import Physics

FURTHEST = 3.0  # standard deviations, at which draws are cut


@dataclass(frozen=True, slots=True)
class DomainRandomization:
    """Standard deviations of the coefficients from session to session or from ball to ball, each as a share of its coefficient."""

    drag: float = param(0.0, "", "standard deviation of the drag coefficients, as a share of them", low=0.0, high=0.5)
    lift: float = param(0.0, "", "standard deviation of the lift coefficients, as a share of them", low=0.0, high=0.5)
    spin_decay: float = param(0.0, "", "standard deviation of the rate at which the spin decays, as a share of it", low=0.0, high=0.5)
    restitution: float = param(0.0, "", "standard deviation of the restitution of the table, as a share of it", low=0.0, high=0.5)
    friction: float = param(0.0, "", "standard deviation of the friction of the table, as a share of it", low=0.0, high=0.5)
    grip: float = param(0.0, "", "standard deviation of the grip of the table, as a share of it", low=0.0, high=0.5)
    rubber_restitution: float = param(0.0, "", "standard deviation of the restitution of the rubber, as a share of it", low=0.0, high=0.5)
    rubber_grip: float = param(
        0.0, "", "standard deviation of the tangential and rotational coefficients of the rubber, as a share of them", low=0.0, high=0.5
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)

    def draw(self, physics: Physics, rng: np.random.Generator) -> Physics:
        """Draw the physics of one session or ball.

        Coefficients are cut as by `multiplied` of `tt_core.factors`.

        Args:
            physics: The means.
            rng: Of the draw; every coefficient takes one number, so that seeds stay comparable.
        """
        draws = dict(zip(_ORDER, np.clip(rng.normal(size=len(_ORDER)), -FURTHEST, FURTHEST).tolist(), strict=True))

        def factor(name: str) -> float:
            return 1.0 + getattr(self, name) * draws[name]

        drawn = multiplied(physics, [factor(name) for name in FACTORS])
        return replace(drawn, air=replace(drawn.air, spin_decay=drawn.air.spin_decay * factor("spin_decay")))


_ORDER = ("drag", "lift", "grip", "rubber_grip", "spin_decay", "restitution", "friction", "rubber_restitution")
