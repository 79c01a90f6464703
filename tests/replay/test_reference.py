"""The reference recordings, through the same functions without ROS: what is measured and predicted from their images is what was true."""

from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from tt_core.flight import fly
from tt_core.physics import Physics
from tt_core.ros.convert import ball_from_message, image_from_message, path_from_message, seconds
from tt_predict.rollout import StopRule, rollout
from tt_vision.capture.assembler import Assembler
from tt_vision.measure import measure_burst
from tt_vision.rig import high_speed_pair

BAGS = sorted((Path(__file__).parents[2] / "bags").glob("reference_*"))
PHYSICS = Physics.liu()


def read(bag):
    """Messages by topic, in order."""
    with AnyReader([bag]) as reader:
        found = {connection.topic: [] for connection in reader.connections}
        for connection, _, raw in reader.messages():
            found[connection.topic].append(reader.deserialize(raw, connection.msgtype))
    return found


def test_there_is_something_to_check():
    assert BAGS


@pytest.mark.parametrize("bag", BAGS, ids=lambda bag: bag.name)
def test_what_is_measured_and_predicted_is_what_was_true(bag):
    found, cameras, assembler, bursts = read(bag), high_speed_pair(), Assembler(), []
    images = [(seconds(m.header.stamp), side, m) for side, name in enumerate(("left", "right")) for m in found[f"/camera/{name}/image_raw"]]
    for time, side, message in sorted(images, key=lambda row: row[:2]):
        bursts.append(assembler.add(side, time, image_from_message(message)))
    (burst,) = [burst for burst in bursts if burst]
    ball = measure_burst(burst.seen_by(cameras)).ball

    launched = ball_from_message(found["/sim/ball"][0])
    true = fly(launched.vector, ball.time - launched.time, PHYSICS.air.coefficients)
    assert ball.position == pytest.approx(true[:3], abs=3e-4)  # m, what 95 % of measurements keep
    assert ball.velocity == pytest.approx(true[3:6], abs=0.04)  # m/s, likewise
    assert np.linalg.norm(ball.spin - true[6:]) < 3.15  # rad/s, 30 rpm, likewise

    (recorded,) = map(path_from_message, found["/ball/path"])
    path = rollout(ball, PHYSICS, StopRule.at_time(recorded.times[-1]))
    # m: 0.5 s of flight at the allowed velocity error; 1e-9 as long as the measurement is the one that made the recording
    assert path.end.position == pytest.approx(recorded.end.position, abs=0.02)
