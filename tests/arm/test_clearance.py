"""What is called clear is clear of the table."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tt_arm.clearance import FOREARM, RIM, clearance, from_table
from tt_arm.model import ArmModel
from tt_arm.reach import reach
from tt_arm.swing import Joints, plan
from tt_core.constants import TABLE_WIDTH
from tt_core.states import RacketState

MODEL = ArmModel.pa10()
postures = arrays(float, 7, elements=st.floats(-1.0, 1.0)).map(lambda x: x * MODEL.position_limits[:, 1])


def test_distances_to_the_table_top():
    assert from_table(1.0, 0.7, 0.2) == pytest.approx(0.2)
    assert from_table(-0.3, 0.7, 0.4) == pytest.approx(0.5)
    assert from_table(1.0, -0.3, -0.01) == pytest.approx(0.3)
    assert from_table(1.0, 0.7, -0.02) == 0.0
    assert from_table(1.0, 0.7, -0.53) == pytest.approx(0.5)


@given(postures)
def test_it_bounds_the_distance_of_the_face(q):
    face, _ = MODEL.racket(q)
    assert clearance(q, MODEL.chain) <= from_table(*face) + RIM
    assert clearance(q, MODEL.chain) >= -FOREARM


@given(postures)
def test_a_mirror_image_is_as_clear(q):
    """About the table's middle, where the base stands: z joints turn the other way."""
    assert MODEL.chain.base_position[1] == pytest.approx(TABLE_WIDTH / 2)
    mirrored = q * [-1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0]
    assert clearance(mirrored, MODEL.chain) == pytest.approx(clearance(q, MODEL.chain), abs=1e-9)


def test_a_strike_in_the_table_is_refused():
    start = Joints(0.0, MODEL.waiting, np.zeros(7))
    for height, clear in ((0.3, True), (0.06, False)):
        racket = RacketState(2.0, np.array([0.05, 0.7, height]), np.array([0.3, 0.0, 0.3]), 0.0, 1.4)
        reason = plan(MODEL, start, reach(MODEL, racket, MODEL.waiting), 2.0).reason
        assert reason is None if clear else "of the table on the way" in reason
