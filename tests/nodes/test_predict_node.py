"""The node is wired: a state in, its path out, nonsense survived."""

import json
import math
from functools import partial

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from refusals import check_named, is_told
from trajectory_msgs.msg import MultiDOFJointTrajectory
from tt_core.errors import MessageFailure, ValueFailure
from tt_core.failures import Failure
from tt_core.physics import Physics
from tt_core.ros.convert import LARGEST_STAMP, VARIANCE, ball_to_message, path_from_message
from tt_core.ros.diagnostics import read_status
from tt_core.ros.qos import RELIABLE
from tt_core.states import BallState
from tt_predict.identify import Identified, write_parameters
from tt_predict.rollout import StopRule, rollout
from tt_predict.uncertainty import uncertainty

BALL = BallState(100.0, [2.6, 0.76, 0.3], [-6.2, 0.1, 1.0], [20, -360, 30])


def test_a_state_in_is_its_path_out(start, probe, until):
    start("tt_predict.predict_node", "--ros-args", "-p", "until_x:=-0.2", "-r", "/ball/state:=/ball/measured", "-p", "air.drag:=0.4")
    got = []
    probe.create_subscription(MultiDOFJointTrajectory, "/ball/path", got.append, RELIABLE)
    out = probe.create_publisher(Odometry, "/ball/measured", RELIABLE)
    until(lambda: out.get_subscription_count() == 1 and probe.count_publishers("/ball/path") == 1, probe)

    out.publish(Odometry())  # no frame: refused, survived
    until(lambda: got or out.publish(ball_to_message(BALL)), probe)
    physics = Physics(air=type(Physics.liu().air)(drag=0.4))
    path, wanted = path_from_message(got[0]), rollout(BALL, physics, StopRule.at_x(-0.2))
    assert len(path.bounces) == 1
    # 1e-6: a stamp holds whole nanoseconds, in which the ball flies 6e-9 m
    assert path.end.vector == pytest.approx(wanted.end.vector, abs=1e-6)


def test_identified_coefficients_are_taken_and_the_covariance_is_told(start, probe, until, tmp_path):
    found = Identified(Physics.liu(), ("air.drag",), np.array([0.4]), np.array([0.01]), {}, (1e-3, 1e-3))
    write_parameters(found, "liu", tmp_path / "found.yaml")
    start("tt_predict.predict_node", "--ros-args", "--params-file", str(tmp_path / "found.yaml"), "-p", "until_x:=-0.2")
    got, statuses = [], []
    probe.create_subscription(MultiDOFJointTrajectory, "/ball/path", got.append, RELIABLE)
    probe.create_subscription(DiagnosticArray, "/diagnostics", lambda m: statuses.extend(read_status(m)), RELIABLE)
    out = probe.create_publisher(Odometry, "/ball/state", RELIABLE)
    until(lambda: out.get_subscription_count() == 1 and probe.count_publishers("/diagnostics") == 1, probe)

    covariance = np.diag(np.repeat([5e-4, 0.02, 10.0], 3) ** 2)
    ball = BallState.from_vector(BALL.time, BALL.vector, covariance)
    until(lambda: (got and any("covariance" in values for *_, values in statuses)) or out.publish(ball_to_message(ball)), probe)
    physics = Physics(air=type(Physics.liu().air)(drag=0.4))
    assert path_from_message(got[0]).end.vector == pytest.approx(rollout(BALL, physics, StopRule.at_x(-0.2)).end.vector, abs=1e-6)
    wanted = uncertainty(ball, physics, StopRule.at_x(-0.2)).covariance
    for values in (values for *_, values in statuses if "covariance" in values):
        # four digits are told
        assert np.array(json.loads(values["covariance"])) == pytest.approx(wanted, rel=1e-3, abs=1e-9 * np.abs(wanted).max())
        assert float(values["sigma_time_ms"]) == pytest.approx(1e3 * np.sqrt(wanted[0, 0]), abs=0.01)


def state(**fields):
    """A good state with other numbers: position, linear, angular of "x", pose or twist covariance of (index, number), stamp."""
    message = ball_to_message(BallState.from_vector(BALL.time, BALL.vector, np.eye(9)))
    pose, twist = message.pose, message.twist
    for name, value in fields.items():
        if name == "position":
            pose.pose.position.x = value
        elif name in ("linear", "angular"):
            getattr(twist.twist, name).y = value
        elif name in ("pose", "twist"):
            getattr(message, name).covariance[value[0]] = value[1]
        elif name == "stamp":
            message.header.stamp.sec, message.header.stamp.nanosec = value
        else:
            setattr(message, name, value)
    return message


BAD_STATES = {  # and what the refusal tells
    "empty": (Odometry(), Failure(MessageFailure.OTHER_FRAME)),
    "NaN position": (state(position=math.nan), Failure(ValueFailure.NOT_FINITE, name="position")),
    "far": (state(position=1e17), Failure(ValueFailure.OUT_OF_RANGE, name="position", value=1e17)),
    "infinite velocity": (state(linear=math.inf), Failure(ValueFailure.NOT_FINITE, name="velocity")),
    "fast": (state(linear=-1e300), Failure(ValueFailure.OUT_OF_RANGE, name="velocity", value=-1e300)),
    "spin": (state(angular=1e300), Failure(ValueFailure.OUT_OF_RANGE, name="spin", value=1e300)),
    "NaN spin": (state(angular=math.nan), Failure(ValueFailure.NOT_FINITE, name="spin")),
    "NaN covariance": (state(pose=(0, math.nan)), Failure(ValueFailure.NOT_FINITE, name="covariance of the pose")),
    "infinite covariance": (state(twist=(35, math.inf)), Failure(ValueFailure.NOT_FINITE, name="covariance of the twist")),
    "huge covariance": (state(twist=(35, 1e300)), Failure(ValueFailure.OUT_OF_RANGE, value=1e300, high=VARIANCE)),
    "negative variance": (state(twist=(0, -1.0)), Failure(MessageFailure.NEGATIVE_VARIANCE, name="covariance of the twist", variance=-1.0)),
    "not symmetric": (state(twist=(1, 0.5)), Failure(MessageFailure.NOT_SYMMETRIC, difference=0.5)),
    "orientation": (state(pose=(35, -1.0)), Failure(MessageFailure.NEGATIVE_VARIANCE, name="covariance of the pose", variance=-1.0)),
    "before 1970": (state(stamp=(-1, 0)), Failure(ValueFailure.OUT_OF_RANGE, value=-1.0, high=LARGEST_STAMP)),
    "nanoseconds": (state(stamp=(0, 4 * 10**9)), Failure(MessageFailure.BAD_STAMP, nanosec=4 * 10**9)),
    "end of time": (state(stamp=(2**31 - 1, 0)), Failure(ValueFailure.OUT_OF_RANGE, value=2.0**31 - 1.0, high=LARGEST_STAMP)),
    "other frame": (state(child_frame_id="racket"), Failure(MessageFailure.OTHER_FRAME)),
    "oversize": (state(child_frame_id="x" * 10**5), Failure(MessageFailure.TOO_LARGE)),
}
EXTREME_STATES = [
    state(stamp=(0, 0)),
    state(position=100.0),
    state(position=-100.0),
    state(linear=100.0, angular=3000.0),
    state(linear=0.0, angular=0.0),
    state(pose=(0, 1e12), twist=(35, 1e12)),
]


def test_it_lives_through_whatever_comes(start, probe, until):
    """Each bad state is refused by its code, states at the bounds are answered or refused, and the next good one is answered."""
    start("tt_predict.predict_node")
    got, statuses = [], []
    probe.create_subscription(MultiDOFJointTrajectory, "/ball/path", got.append, RELIABLE)
    probe.create_subscription(DiagnosticArray, "/diagnostics", lambda message: statuses.extend(read_status(message)), RELIABLE)
    out = probe.create_publisher(Odometry, "/ball/state", RELIABLE)
    until(lambda: out.get_subscription_count() == 1 and probe.count_publishers("/diagnostics") == 1, probe)

    def answers_the_next_state():
        got.clear()
        until(lambda: got or out.publish(ball_to_message(BALL)), probe)

    for message, failure in BAD_STATES.values():
        statuses.clear()
        until(lambda failure=failure, message=message: is_told(failure, statuses) or out.publish(message), probe)
    answers_the_next_state()
    for message in EXTREME_STATES:
        out.publish(message)
        answers_the_next_state()
        for path in map(path_from_message, got):  # all that was published is within its bounds
            assert np.isfinite(path.positions).all()


@pytest.mark.parametrize(
    ("parameter", "named"),
    [
        ("air.drag:=3.0", ("drag", 3, 0, 2)),
        ("physics:=newton", ("physics", "newton", "liu", "measured")),
        ("until_x:=far", ("until_x", "far", "-0.8")),
    ],
)
def test_a_bad_parameter_ends_it_with_the_reason(start, parameter, named):
    node = start("tt_predict.predict_node", "--ros-args", "-p", parameter)
    assert node.wait(timeout=120) == 2
    check_named(node.stderr.read(), *named)


def test_a_clock_before_1970_does_not_end_a_node(start, probe, until):
    from builtin_interfaces.msg import Time
    from diagnostic_msgs.msg import DiagnosticArray
    from rosgraph_msgs.msg import Clock

    node = start("tt_predict.predict_node", "--ros-args", "-p", "use_sim_time:=true")
    clock = probe.create_publisher(Clock, "/clock", 10)
    until(lambda: clock.get_subscription_count() == 1, probe)
    statuses = []
    probe.create_subscription(DiagnosticArray, "/diagnostics", statuses.append, 10)

    def follows():
        for seconds in (-1, -(2**31), 2**31 - 1, 5):
            clock.publish(Clock(clock=Time(sec=seconds, nanosec=7)))
        return any(message.header.stamp.sec == 5 for message in statuses)

    until(follows, probe)
    assert node.poll() is None


def test_a_first_estimate_has_a_path_and_what_replaces_it_another(start, probe, until):
    start("tt_predict.predict_node", "--ros-args", "-p", "first:=true")
    got = []
    probe.create_subscription(MultiDOFJointTrajectory, "/ball/path", got.append, RELIABLE)
    first, state = (probe.create_publisher(Odometry, topic, RELIABLE) for topic in ("/ball/first", "/ball/state"))
    until(lambda: all(p.get_subscription_count() == 1 for p in (first, state)) and probe.count_publishers("/ball/path") == 1, probe)
    rough = BallState(BALL.time, BALL.position, BALL.velocity + [0.05, 0.0, 0.0], BALL.spin)

    def is_answered(publisher, ball):
        if got and path_from_message(got[-1]).velocities[0] == pytest.approx(ball.velocity, abs=1e-9):
            return True
        publisher.publish(ball_to_message(ball))  # again, as the path is lost if the node does not know yet who listens
        return False

    for publisher, ball in ((first, rough), (state, BALL)):
        until(partial(is_answered, publisher, ball), probe)
