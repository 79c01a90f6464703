"""A stroke on its way is corrected as far as the arm can, without a jump."""

import numpy as np
import pytest
from arm.dissertation_strokes import printed
from tt_arm.joints import Joints
from tt_arm.model import ArmModel
from tt_arm.reach import ReachParams, reach
from tt_arm.stroke_correction import between, by_distance, corrections, postures, stroke_distances
from tt_arm.stroke_selection import PlannedStroke, SelectionParams, select_stroke
from tt_arm.swing import SwingLimits
from tt_core.states import RacketState

MODEL, FIRST, LIMITS = ArmModel.pa10(), printed(0.55)[0], SwingLimits()


def moved(shift, time=FIRST.time):
    return RacketState(time, FIRST.position + shift, FIRST.velocity, FIRST.alpha, FIRST.beta)


def test_the_nearest_candidate_is_first_and_half_of_the_way_after_its_neighbour():
    same, later, far = moved([0.02, 0, 0]), moved([0.04, 0, 0] + 0.012 * FIRST.velocity, FIRST.time + 0.012), moved([0.3, 0, 0])
    candidates = [far, later, same]
    order = by_distance(candidates, FIRST)
    assert order == [2, 1, 0]
    found = corrections(candidates, order, FIRST)
    assert [one.candidate for one in found] == [2, 1, 2, 0, 0]
    assert found[0].racket is same
    assert found[2].racket.position == pytest.approx(FIRST.position + [0.01, 0, 0])
    half, whole = stroke_distances(FIRST, [found[2].racket, same])
    assert half == pytest.approx(0.5 * whole)
    assert stroke_distances(FIRST, []).shape == (0,)


def test_half_way_is_between_in_everything():
    other = RacketState(FIRST.time, FIRST.position + 0.1, FIRST.velocity + 1.0, FIRST.alpha + 0.2, FIRST.beta - 0.2)
    half = between(FIRST, other)
    assert half.position == pytest.approx(FIRST.position + 0.05) and half.velocity == pytest.approx(FIRST.velocity + 0.5)
    assert half.normal @ FIRST.normal == pytest.approx(half.normal @ other.normal)
    assert between(FIRST, FIRST).normal == pytest.approx(FIRST.normal)


def test_postures_of_a_changed_stroke_make_it():
    before, changed = reach(MODEL, FIRST, MODEL.waiting), moved([0.0, 0.03, 0.01])
    found = list(postures(MODEL, changed, before, MODEL.limits))
    assert len(found) == 2 and found[1].ratio <= found[0].ratio + 1e-9  # the second has the least joint speeds
    for one in found:
        position, rotation = MODEL.racket(one.q)
        assert position == pytest.approx(changed.position, abs=1e-6) and rotation[:, 2] == pytest.approx(changed.normal, abs=1e-6)
        assert MODEL.jacobian(one.q)[:3] @ one.qdot == pytest.approx(changed.velocity, abs=1e-5)


def test_a_correction_that_is_too_far_goes_half_of_the_way():
    params = SelectionParams()
    selected = select_stroke(MODEL, [FIRST], Joints.at_rest(0.0, MODEL.waiting), LIMITS, ReachParams(), params)
    late = selected.swing.joints(FIRST.time - 0.1)  # 0.1 s are enough for some change only
    current, shifts = PlannedStroke(selected.racket, selected.reach), []
    for shift in np.arange(0.0, 0.2, 0.004):
        found = select_stroke(MODEL, [moved([0.0, shift, 0.0])], late, LIMITS, ReachParams(), params, current)
        if found.racket is not None:
            shifts.append((shift, found.racket.position[1] - FIRST.position[1]))
            assert found.swing.sample(late.time) == (pytest.approx(late.q, abs=1e-9), pytest.approx(late.qdot, abs=1e-9))
    full = [wanted for wanted, got in shifts if abs(got - wanted) < 1e-9]
    half = [wanted for wanted, got in shifts if abs(got - 0.5 * wanted) < 1e-9 and wanted > 0.0]
    assert full and half and max(half) > max(full)


def test_a_margin_of_joint_speed_is_kept_where_it_can_be():
    start, fast = Joints.at_rest(0.0, MODEL.waiting), printed(0.75)
    for racket in fast:
        plain, kept = (
            select_stroke(MODEL, [racket], start, LIMITS, ReachParams(), SelectionParams(margin=margin)) for margin in (0.0, 0.2)
        )
        assert plain.index == 0 and kept.index == 0  # a margin refuses nothing
        assert kept.reach.ratio <= max(0.8, plain.reach.ratio) + 1e-9
    assert any(
        select_stroke(MODEL, [racket], start, LIMITS, ReachParams(), SelectionParams(margin=0.2)).reach.ratio <= 0.8 for racket in fast
    )
