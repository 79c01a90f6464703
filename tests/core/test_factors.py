"""A factor changes the coefficients that it names and no other ones, and no surface gives energy to the ball."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tt_core.factors import FACTORS, scaled
from tt_core.physics import Physics
from tt_core.states import RacketState

PHYSICS = Physics.measured()


def test_each_factor_scales_its_coefficients_only():
    of = {
        "drag": lambda p: p.air.drag,
        "lift": lambda p: p.air.lift_ratio,
        "restitution": lambda p: p.table.restitution,
        "friction": lambda p: p.table.friction,
        "grip": lambda p: p.table.grip,
        "rubber_restitution": lambda p: p.racket.restitution,
        "rubber_grip": lambda p: p.racket.tangential,
    }
    for i, name in enumerate(FACTORS):
        logarithms = np.zeros(len(FACTORS))
        logarithms[i] = 0.02
        found = scaled(PHYSICS, logarithms)
        for other, value in of.items():
            assert value(found) / value(PHYSICS) == pytest.approx(np.exp(0.02) if other == name else 1.0)
    assert scaled(PHYSICS, ()) == replace(PHYSICS)


@given(st.lists(st.floats(-100.0, 100.0), min_size=7, max_size=7))
def test_no_factors_give_energy_to_the_ball(logarithms):
    physics = scaled(PHYSICS, logarithms)
    velocity, spin = np.array([-5.0, 0.5, -3.0]), np.array([10.0, -200.0, 50.0])
    inertia = 2.0 / 3.0 * 0.02**2  # m^2, of a thin shell, over its mass
    before = velocity @ velocity + inertia * spin @ spin
    racket = RacketState.facing(0.0, [0, 0, 0], [0, 0, 0], np.array([0.0, 0.0, 1.0]))
    for after, turned in (physics.table.after(velocity, spin), physics.racket.after(velocity, spin, racket)):
        assert after @ after + inertia * turned @ turned <= before * (1.0 + 1e-9)
