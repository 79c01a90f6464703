"""Random differences of the true coefficients: those of a session from those of the world, those of a ball from those of its session.

What is constant in a session, such as rubber, table and the air of a hall, can be learnt; differences from ball to ball cannot.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from tt_core.factors import FACTORS, multiplied
from tt_core.params import check, param
from tt_core.physics import Physics

FURTHEST = 3.0  # standard deviations, largest deviation that is drawn


@dataclass(frozen=True, slots=True)
class DomainRandomization:
    """Standard deviations of the true coefficients from session to session or from ball to ball, each as a share of its coefficient."""

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
        """Draw the physics of one session or of one ball at random.

        The coefficients are limited as by `tt_core.factors.multiplied`.

        Args:
            physics: Models with the mean coefficients.
            rng: Random numbers. Each coefficient takes one number, whatever its deviation, so that results of equal seeds can be compared.
        """
        draws = dict(zip(_ORDER, np.clip(rng.normal(size=len(_ORDER)), -FURTHEST, FURTHEST).tolist(), strict=True))

        def factor(name: str) -> float:
            return 1.0 + getattr(self, name) * draws[name]

        drawn = multiplied(physics, [factor(name) for name in FACTORS])
        return replace(drawn, air=replace(drawn.air, spin_decay=drawn.air.spin_decay * factor("spin_decay")))


_ORDER = ("drag", "lift", "grip", "rubber_grip", "spin_decay", "restitution", "friction", "rubber_restitution")
