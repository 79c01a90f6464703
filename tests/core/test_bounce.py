"""Rebounds keep what physics keeps."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tt_core.bounce import RacketRebound, TableRebound
from tt_core.constants import BALL_MASS, BALL_RADIUS
from tt_core.errors import NotFinite, OutOfRange
from tt_core.flight import DRAG_UNIT, LIFT_UNIT
from tt_core.physics import Physics, physics_coefficients
from tt_core.states import RacketState

TABLES = [TableRebound.liu(), TableRebound.measured()]
RACKETS = [RacketRebound.liu(), RacketRebound.measured()]
spins = arrays(float, 3, elements=st.floats(-900, 900, allow_subnormal=False))
falling = arrays(float, 3, elements=st.floats(-12, 12, allow_subnormal=False)).map(lambda v: v * [1, 1, 0] - [0, 0, abs(v[2]) + 0.01])
vectors = arrays(float, 3, elements=st.floats(-5, 5, allow_subnormal=False))
angles = st.floats(-3, 3)


def energy(v, w):
    return 0.5 * BALL_MASS * (v @ v + 2 / 3 * BALL_RADIUS**2 * (w @ w))


@pytest.mark.parametrize("table", TABLES)
@given(falling, spins)
def test_a_bounce_never_gains_energy_and_keeps_the_spin_about_the_normal(table, v, w):
    v1, w1 = table.after(v, w)
    assert energy(v1, w1) <= energy(v, w) * (1 + 1e-12)
    assert w1[2] == w[2]
    assert v1[2] == pytest.approx(-table.restitution * v[2])


@pytest.mark.parametrize("table", TABLES)
@given(falling, spins)
def test_a_mirror_image_bounces_mirrored(table, v, w):
    v1, w1 = table.after(v, w)
    v2, w2 = table.after(v * [1, -1, 1], w * [-1, 1, -1])
    assert np.concatenate([v2 * [1, -1, 1], w2 * [-1, 1, -1]]) == pytest.approx(np.concatenate([v1, w1]))


@pytest.mark.parametrize("table", TABLES)
@given(falling, spins, st.floats(-math.pi, math.pi))
def test_the_table_is_the_same_in_every_direction(table, v, w, angle):
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    v1, w1 = table.after(v, w)
    v2, w2 = table.after(turn @ v, turn @ w)
    assert np.concatenate([v2, w2]) == pytest.approx(np.concatenate([turn @ v1, turn @ w1]), abs=1e-9)


def test_slip_and_roll_meet():
    """nu_s of (3.13) is 0 where |slip| = 2.5 mu (1 + e) |v_z|."""
    liu = TableRebound.liu()
    slip = 2.5 * liu.friction * (1 + liu.restitution) * 2.0
    both = [np.concatenate(liu.after([slip * (1 + s), 0, -2.0], [0, 0, 0])) for s in (-1e-9, 1e-9)]
    assert both[0] == pytest.approx(both[1], abs=1e-6)


@given(falling)
def test_a_ball_that_rolls_leaves_no_slip_in_grip(v):
    v1, w1 = TableRebound(friction=2.0).after(v * [0.01, 0.01, 1] - [0, 0, 0.1], np.zeros(3))
    assert [v1[0] - BALL_RADIUS * w1[1], v1[1] + BALL_RADIUS * w1[0]] == pytest.approx([0, 0], abs=1e-12)


@pytest.mark.parametrize("rubber", RACKETS)
@given(vectors, spins, vectors, angles, angles)
def test_the_racket_obeys_its_own_conservation_laws(rubber, v, w, racket_velocity, alpha, beta):
    racket = RacketState(0.0, np.zeros(3), racket_velocity, alpha, beta)
    v1, w1 = rubber.after(v, w, racket)
    n = racket.normal if (v - racket_velocity) @ racket.normal <= 0 else -racket.normal
    assert (w1 - w) @ n == pytest.approx(0, abs=1e-9)
    assert w1 - w == pytest.approx(rubber.turn * np.cross(v1 - v, n), abs=1e-6)  # (4.14)
    assert (v1 - racket_velocity) @ n >= -1e-12


def test_the_racket_does_what_the_printed_matrices_do():
    """(3.25)-(3.28) written out, against the kernel."""
    r, kv, kw, e = BALL_RADIUS, 0.615, 2570.0, 0.73
    s12 = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 0.0]])
    racket = RacketState(0.0, np.zeros(3), [1.5, 0.1, 1.3], -0.1, 0.8)
    turn = racket.rotation
    v, w = np.array([-3.0, 0.2, 0.4]), np.array([20.0, 150.0, -30.0])
    u, s = turn.T @ (v - racket.velocity), turn.T @ w
    v1 = turn @ (np.diag([1 - kv, 1 - kv, -e]) @ u + kv * r * s12 @ s) + racket.velocity
    w1 = turn @ (-kw * r * s12 @ u + np.diag([1 - kw * r * r, 1 - kw * r * r, 1]) @ s)
    got = RacketRebound.liu().after(v, w, racket)
    assert got[0] == pytest.approx(v1, abs=1e-12)
    assert got[1] == pytest.approx(w1, abs=1e-9)


def test_both_faces_are_alike():
    v, w = [-3.0, 0.2, 0.4], [20.0, 150.0, -30.0]
    one = RacketState(0.0, np.zeros(3), [1.0, 0, 1], 0.0, 0.8)
    other = RacketState.facing(0.0, np.zeros(3), one.velocity, -one.normal)
    for rubber in RACKETS:
        assert np.concatenate(rubber.after(v, w, one)) == pytest.approx(np.concatenate(rubber.after(v, w, other)))


def test_a_faster_hit_gives_less_back_where_measured():
    measured = RacketRebound.measured()
    flat = RacketState(0.0, np.zeros(3), np.zeros(3), 0.0, 0.0)
    ratios = [measured.after([0, 0, -v], [0, 0, 0], flat)[0][2] / v for v in (0.1, 5.0, 11.0, 20.0)]
    assert ratios == pytest.approx([0.917 - 0.00214, 0.917 - 0.107, 0.917 - 0.2354, 0.665])


def test_bad_values_name_themselves():
    with pytest.raises(OutOfRange) as error:
        TableRebound.liu().after([0, 0, 1.0], [0, 0, 0])
    assert (error.value.value, error.value.high) == (1.0, 0.0)
    with pytest.raises(OutOfRange) as error:
        TableRebound(restitution=1.1)
    assert (error.value.name, error.value.value, error.value.low, error.value.high) == ("restitution", 1.1, 0.0, 1.0)
    with pytest.raises(NotFinite) as error:
        TableRebound(friction=math.nan)
    assert error.value.name == "friction"


def test_coefficients_have_the_names_of_their_models():
    """The arrays that kernels take are named in the order in which they are made."""
    physics = Physics.measured(0.015)
    air, table, racket, contact_height = physics_coefficients(physics.coefficients)
    assert air.gravity == physics.air.gravity and air.spin_decay == physics.air.spin_decay
    assert air.lift_ratio == physics.air.lift_ratio * LIFT_UNIT and air.drag == physics.air.drag * DRAG_UNIT
    assert table == (physics.table.restitution, physics.table.friction, physics.table.grip)
    assert racket._asdict() == {name: getattr(physics.racket, name) for name in racket._fields}
    assert contact_height == 0.015
