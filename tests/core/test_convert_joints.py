"""Joint states as drivers send them."""

import numpy as np
import pytest
from sensor_msgs.msg import JointState
from tt_core.errors import BadMessage, NotFinite
from tt_core.ros.convert import joints_from_message

NAMES = ["a", "b"]


def message(name=("b", "a"), position=(2.0, 1.0), velocity=(20.0, 10.0)):
    return JointState(name=list(name), position=list(position), velocity=list(velocity))


@pytest.mark.parametrize(
    ("given", "q", "qdot"),
    [
        (message(), [1, 2], [10, 20]),
        (message(velocity=()), [1, 2], None),
        (message(velocity=(np.nan, np.nan)), [1, 2], None),  # ros2_control, where the hardware has no speeds
        (message(("gripper", "b", "a"), (0.5, 2.0, 1.0), (0.0, 20.0, 10.0)), [1, 2], [10, 20]),
        (message(("gripper", "b", "a"), (0.5, 2.0, 1.0), ()), [1, 2], None),
        (message(("gripper", "b", "a"), (np.nan, 2.0, 1.0), (np.nan, 20.0, 10.0)), [1, 2], [10, 20]),
    ],
)
def test_the_joints_are_found_by_name(given, q, qdot):
    _, position, velocity = joints_from_message(given, NAMES)
    assert position.tolist() == q
    assert (None if velocity is None else velocity.tolist()) == qdot


@pytest.mark.parametrize("given", [JointState(), message(("gripper",), (0.5,), (0.0,))])
def test_a_message_with_none_of_the_joints_is_for_others(given):
    assert joints_from_message(given, NAMES) is None


@pytest.mark.parametrize(
    "given",
    [
        message(("a", "c")),
        message(("a", "a", "b"), (1.0, 1.0, 2.0), ()),
        message(position=(1.0,)),
        message(position=(1.0, 2.0, 3.0)),
        message(velocity=(1.0,)),
        message(position=(1.0, np.nan)),
        message(velocity=(np.inf, 0.0)),
        message(velocity=(np.nan, 0.0)),
        message(position=()),
    ],
)
def test_what_is_not_whole_is_refused(given):
    with pytest.raises((BadMessage, NotFinite)):
        joints_from_message(given, NAMES)
