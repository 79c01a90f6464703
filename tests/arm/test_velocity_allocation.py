"""Joint speeds are the least possible, and the dissertation's are not."""

import numpy as np
import pytest
from arm.dissertation_strokes import NAMES, REFERENCE_WAITING, printed
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import linprog
from tt_arm.ik.closed_form import inverse
from tt_arm.ik.velocity_allocation import NoJointSpeeds, allocate, least_shares, least_shares_steady, steady_rows
from tt_arm.model import ArmModel
from tt_arm.reach import reach

MODEL = ArmModel.pa10()
postures = arrays(float, 7, elements=st.floats(-1.0, 1.0)).map(lambda x: x * MODEL.position_limits[:, 1])
velocities = arrays(float, 3, elements=st.floats(-3.0, 3.0))


def linear_programme(rows, wanted):
    """The same problem given to a general solver."""
    one, unit = np.ones((7, 1)), np.eye(7)
    bounds = [(None, None)] * 7 + [(0, None)]
    above, equal = np.block([[unit, -one], [-unit, -one]]), np.hstack([rows, np.zeros((len(rows), 1))])
    return linprog(np.eye(8)[7], above, np.zeros(14), equal, wanted, bounds)


def rows_at(q):
    return steady_rows(MODEL.jacobian(q), MODEL.racket(q)[1], MODEL.speed_limits)


@settings(max_examples=60)
@given(postures, velocities, st.booleans())
def test_least_shares_are_those_of_a_linear_programme(q, velocity, steady):
    rows, shares = rows_at(q), np.empty(7)
    if not steady:
        rows, wanted = rows[:3].copy(), velocity
        ratio = least_shares(rows, wanted, shares)
    else:
        wanted = np.append(velocity, [0.0, 0.0])
        ratio = least_shares_steady(rows, wanted, shares)
    if np.linalg.cond(rows) > 1e5:  # near a singular posture both solvers only claim what they can resolve
        return
    assert ratio == pytest.approx(linear_programme(rows, wanted).fun, rel=1e-6, abs=1e-6)
    assert rows @ shares == pytest.approx(wanted, abs=1e-6 * (1.0 + ratio))
    assert np.abs(shares).max() <= ratio * (1.0 + 1e-6) + 1e-12


def test_parallel_columns_share_alike():
    """A made-up arm: three joints push along x, so each takes a third of what is left."""
    columns = np.zeros((3, 7))
    columns[0, :3], columns[1, 3], columns[2, 4] = 1.0, 1.0, 1.0
    shares = np.empty(7)
    assert least_shares(columns, np.array([0.9, 0.6, 0.1]), shares) == pytest.approx(0.6)
    assert shares == pytest.approx([0.3, 0.3, 0.3, 0.6, 0.1, 0.0, 0.0])


def test_what_no_joint_can_do_is_told():
    with pytest.raises(NoJointSpeeds):
        allocate(MODEL, np.zeros(7), np.array([0.0, 0.0, 1.0]))  # stretched upright


@given(postures, velocities)
def test_the_racket_moves_as_asked(q, velocity):
    for steady in (False, True):
        try:
            qdot = allocate(MODEL, q, velocity, steady=steady)
        except NoJointSpeeds:
            continue
        if np.abs(qdot).max() < 100.0:
            moved = MODEL.jacobian(q) @ qdot
            assert moved[:3] == pytest.approx(velocity, abs=1e-7)
            normal = MODEL.racket(q)[1][:, 2]
            assert not steady or np.cross(moved[3:], normal) == pytest.approx(np.zeros(3), abs=1e-6)


def test_the_feasibility_table():
    """Largest |qdot_i| / limit_i in the postures of (4.63): printed (4.65) against the least possible (reference table, to 0.01)."""
    table = {
        "Table 4.5, backspin": (0.73, 1.09),
        "Table 4.5, topspin": (0.50, 0.68),
        "Table 4.3, 1": (0.65, 0.95),
        "Table 4.3, 2": (0.62, 0.84),
        "Table 4.3, 3": (0.69, 1.14),
    }
    for name, racket in zip(NAMES, printed(0.0), strict=True):
        least, liu = table[name]
        # 5 %: the reference stopped Newton's iteration in other coordinates of the normal, which end in a slightly other posture
        assert reach(MODEL, racket, REFERENCE_WAITING, method="near").ratio == pytest.approx(least, rel=0.05)
        assert reach(MODEL, racket, REFERENCE_WAITING, method="liu").ratio == pytest.approx(liu, rel=0.05)


def test_the_best_posture_needs_what_the_table_says():
    """The least over a grid of 10 degrees in both freedoms, printed to 0.01; a coarser grid finds at most 0.02 more."""
    table = dict(zip(NAMES, (0.56, 0.54, 0.54, 0.61, 0.42), strict=True))
    q, shares = np.empty(7), np.empty(7)
    for name, racket in zip(NAMES, printed(0.0), strict=True):
        best = np.inf
        for turn in np.arange(0.0, 2 * np.pi, np.pi / 18):
            c, s = np.cos(turn), np.sin(turn)
            turned = racket.rotation @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
            for swivel in np.arange(0.0, 2 * np.pi, np.pi / 18):
                found = inverse(racket.position.copy(), turned, swivel, MODEL.closed_form, q)
                if found and np.all(np.abs(q[[1, 3, 5]]) < MODEL.position_limits[[1, 3, 5], 1]):
                    best = min(best, least_shares(rows_at(q)[:3].copy(), racket.velocity.copy(), shares))
        assert table[name] - 0.01 < best < table[name] + 0.02, name


@pytest.mark.parametrize("n", [5, 6, 7, 8])
def test_any_number_of_joints_has_the_least_shares_of_a_linear_programme(n):
    rng = np.random.default_rng(n)
    for _ in range(100):
        rows, wanted, shares = rng.normal(0.0, 1.0, (5, n)), rng.normal(0.0, 1.0, 5), np.empty(n)
        rows[:, rng.integers(n)] *= rng.integers(2)  # now and then a joint that does nothing
        for part, found in ((rows[:3], least_shares(rows, wanted, shares)), (rows, None)):
            found = least_shares_steady(rows, wanted, shares) if found is None else found
            above = np.vstack([np.hstack([sign * np.eye(n), -np.ones((n, 1))]) for sign in (1, -1)])
            equal = np.hstack([part, np.zeros((len(part), 1))])
            best = linprog(np.eye(n + 1)[n], above, np.zeros(2 * n), equal, wanted[: len(part)], [(None, None)] * n + [(0, None)])
            if not best.success:  # five joints of which one does nothing
                assert np.isinf(found)
                continue
            assert found == pytest.approx(best.fun, rel=1e-7)
            assert np.abs(shares).max() == pytest.approx(found, rel=1e-7)
            assert part @ shares == pytest.approx(wanted[: len(part)], abs=1e-7)
