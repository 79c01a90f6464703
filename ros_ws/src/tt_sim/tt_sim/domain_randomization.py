"""The true coefficients, drawn at random in two levels: those of a session about its world's, those of a ball about its session's.

What is the same in a session, such as rubber, table and the air of a hall, can be learnt; what differs from ball to ball cannot.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
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

        Coefficients are cut where a surface would give energy to the ball.

        Args:
            physics: The means.
            rng: Of the draw; every coefficient takes one number, so that seeds stay comparable.
        """
        draws = dict(zip(_ORDER, np.clip(rng.normal(size=len(_ORDER)), -FURTHEST, FURTHEST).tolist(), strict=True))

        def factor(name: str) -> float:
            return 1.0 + getattr(self, name) * draws[name]

        drag, lift, grip, rubber = factor("drag"), factor("lift"), factor("grip"), factor("rubber_grip")
        air, table, racket = physics.air, physics.table, physics.racket
        tangential = min(racket.tangential * rubber, 0.79)  # above 0.8 a shell would come back faster than it slipped
        rubber = tangential / racket.tangential
        return replace(
            physics,
            air=replace(
                air,
                drag=air.drag * drag,
                drag_h=air.drag_h * drag,
                lift=air.lift * lift,
                lift_h=air.lift_h * lift,
                lift_ratio=air.lift_ratio * lift,
                spin_decay=air.spin_decay * factor("spin_decay"),
            ),
            table=replace(
                table,
                restitution=min(1.0, table.restitution * factor("restitution")),
                friction=table.friction * factor("friction"),
                grip=min(2.0, table.grip * grip),
            ),
            racket=replace(
                racket,
                restitution=min(1.0, racket.restitution * (bounce := factor("rubber_restitution"))),
                restitution_least=min(1.0, racket.restitution * bounce, racket.restitution_least * bounce),
                tangential=tangential,
                tangential_least=racket.tangential_least * rubber,
                rotational=racket.rotational * rubber,
            ),
        )


_ORDER = ("drag", "lift", "grip", "rubber_grip", "spin_decay", "restitution", "friction", "rubber_restitution")
