"""The motors' torques are pinocchio's."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tt_arm.dynamics import joint_torques
from tt_arm.model import ArmModel

MODELS = ArmModel.pa10(), ArmModel.pa10(base=(-0.5, 0.2, 0.1, 0.7), mount=(0.3, 1.0))
numbers = arrays(float, 7, elements=st.floats(-3.0, 3.0))


@pytest.mark.parametrize("model", MODELS)
@given(numbers, numbers, numbers)
def test_torques_are_those_of_pinocchio(model, q, qdot, qddot):
    found = np.empty(7)
    joint_torques(q, qdot, qddot, model.chain, model.links, found, np.empty((7, 6)))
    wanted = pin.rnea(model.pinocchio, model.pinocchio.createData(), q, qdot, qddot)
    assert found == pytest.approx(wanted, abs=1e-10)  # N m, of some 100
