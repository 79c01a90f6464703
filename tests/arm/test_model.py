"""The model is the PA10 of the facts, and the kernels are the model."""

import numpy as np
import pinocchio as pin
import pytest
from arm import appendix_b
from arm.dissertation_strokes import REFERENCE_WAITING
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from tt_arm.ik.closed_form import inverse
from tt_arm.kinematics import forward
from tt_arm.model import ArmModel
from tt_core.errors import BadShape, NotFinite

MODEL = ArmModel.pa10()
postures = arrays(float, 7, elements=st.floats(-1.0, 1.0)).map(lambda x: x * MODEL.position_limits[:, 1])


def rotation(axis, angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]] if axis == "z" else [[c, 0, s], [0, 1, 0], [-s, 0, c]])


def test_the_facts():
    assert np.degrees(MODEL.position_limits) == pytest.approx(np.outer([177, 94, 174, 137, 255, 165, 255], [-1, 1]))
    assert MODEL.speed_limits == pytest.approx([1, 1, 2, 2, 2 * np.pi, 2 * np.pi, 2 * np.pi])
    assert MODEL.closed_form.lengths == pytest.approx([0.315, 0.450, 0.500, 0.080])
    position, turned = MODEL.racket(np.array(REFERENCE_WAITING))
    assert position == pytest.approx([-0.375, 0.660, 0.099], abs=1e-3)  # printed to 1 mm
    assert turned[:, 2] == pytest.approx([0.83, 0.55, 0.01], abs=5e-3)  # printed to 0.01
    # masses: 34.58 kg of links that move with the joints but the base (the universe holds it), 0.18 kg racket
    assert sum(inertia.mass for inertia in MODEL.pinocchio.inertias) == pytest.approx(
        3.04 + 9.78 + 8.41 + 3.51 + 4.31 + 4.01 + 1.46 + 0.24 + 0.18
    )


def test_centres_of_mass_stand_at_their_heights():
    data = MODEL.pinocchio.createData()
    pin.forwardKinematics(MODEL.pinocchio, data, np.zeros(7))
    heights = [(data.oMi[i] * MODEL.pinocchio.inertias[i].lever)[2] + 0.06 for i in range(1, 7)]
    assert heights == pytest.approx([0.148, 0.377, 0.674, 0.810, 1.057, 1.234], abs=1e-9)


@given(postures)
def test_the_kernel_is_pinocchio(q):
    data, frame = MODEL.pinocchio.createData(), MODEL.pinocchio.getFrameId("racket")
    jacobian = pin.computeFrameJacobian(MODEL.pinocchio, data, q, frame, pin.LOCAL_WORLD_ALIGNED)
    pin.framesForwardKinematics(MODEL.pinocchio, data, q)
    position, turned = MODEL.racket(q)
    assert position == pytest.approx(data.oMf[frame].translation, abs=1e-12)
    assert turned == pytest.approx(data.oMf[frame].rotation, abs=1e-12)
    assert MODEL.jacobian(q) == pytest.approx(jacobian, abs=1e-12)


@given(postures)
def test_the_chain_is_appendix_b(q):
    """With the racket at the flange itself."""
    flange, lengths = ArmModel.pa10(base=(0, 0, 0, 0), mount=(0, 0)), MODEL.closed_form.lengths
    position, turned = flange.racket(q)
    printed = appendix_b.pose(q, lengths)
    assert position == pytest.approx(printed[:3, 3], abs=1e-12)
    assert turned == pytest.approx(printed[:3, :3], abs=1e-12)
    assert flange.jacobian(q) == pytest.approx(appendix_b.jacobian(q, lengths), abs=1e-12)


@given(postures)
def test_the_jacobian_is_the_derivative(q):
    h, jacobian = 1e-6, MODEL.jacobian(q)
    for i in range(7):
        step = h * np.eye(7)[i]
        (p1, r1), (p0, r0) = MODEL.racket(q + step), MODEL.racket(q - step)
        turn = (r1 - r0) @ MODEL.racket(q)[1].T / (2 * h)
        # central differences: h^2 and rounding 1e-16/h, both below 1e-9
        assert (p1 - p0) / (2 * h) == pytest.approx(jacobian[:3, i], abs=1e-8)
        assert [turn[2, 1], turn[0, 2], turn[1, 0]] == pytest.approx(jacobian[3:, i], abs=1e-8)


@given(postures, st.floats(-np.pi, np.pi))
@example(np.array([0.5, 0.0, 0.5, 0.5, 0.5, 0.5, 0.5]) * MODEL.position_limits[:, 1], 3.4e-195)  # its square is 0
def test_the_inverse_returns_to_the_pose(q, swivel):
    position, turned, _ = forward(q, MODEL.chain)
    found = np.empty(7)
    assert inverse(position, turned, swivel, MODEL.closed_form, found)
    again, turned_again, _ = forward(found, MODEL.chain)
    assert again == pytest.approx(position, abs=1e-9)  # near the stretched elbow 1e-16 grows to its square root, times the last links
    assert turned_again == pytest.approx(turned, abs=1e-9)


def test_base_and_mount_are_where_they_are_asked():
    moved = ArmModel.pa10(base=(0.1, 0.2, 0.3, 0.5), mount=(0.2, 0.0))
    plain = ArmModel.pa10(base=(0.0, 0.0, 0.0, 0.0), mount=(0.0, 0.0))
    q = MODEL.waiting
    position, turned = plain.racket(q)
    there, turned_there = moved.racket(q)
    assert there == pytest.approx([0.1, 0.2, 0.3] + rotation("z", 0.5) @ (position + 0.2 * turned[:, 2]))
    assert turned_there == pytest.approx(rotation("z", 0.5) @ turned)


def test_bad_values_name_themselves():
    with pytest.raises(BadShape) as error:
        MODEL.racket(np.zeros(6))
    assert (error.value.name, error.value.shape) == ("q", (6,))
    with pytest.raises(NotFinite) as error:
        ArmModel.pa10(base=(np.nan, 0, 0, 0))
    assert error.value.name == "base"
