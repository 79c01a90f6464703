"""The node is wired: a path and a goal in, strokes out, nonsense survived."""

import math

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from refusals import check_named, is_told
from trajectory_msgs.msg import MultiDOFJointTrajectory
from tt_core.errors import MessageFailure, ValueFailure
from tt_core.failures import Failure
from tt_core.flight import fly
from tt_core.physics import Physics
from tt_core.ros.convert import FROM_START, LARGEST_STAMP, MOST_PATH_POINTS, goal_to_message, path_to_message, strokes_from_message
from tt_core.ros.diagnostics import read_status
from tt_core.ros.qos import LATCHED, LATEST, RELIABLE
from tt_core.states import BallState, ReturnGoal
from tt_predict.rollout import StopRule, rollout

BALL = BallState(100.0, [2.6, 0.76, 0.3], [-6.2, 0.1, 1.0], [20, -360, 30])
GOAL = ReturnGoal([2.2, 0.6], 0.55, 60.0, 10.0)


def test_a_path_and_a_goal_in_are_strokes_out(start, probe, until):
    start("tt_racket.racket_node")
    got = []
    probe.create_subscription(MultiDOFJointTrajectory, "/racket/strokes", got.append, LATEST)
    goal = probe.create_publisher(MultiDOFJointTrajectory, "/return/goal", LATCHED)
    out = probe.create_publisher(MultiDOFJointTrajectory, "/ball/path", RELIABLE)
    until(lambda: all(p.get_subscription_count() == 1 for p in (goal, out)) and probe.count_publishers("/racket/strokes") == 1, probe)

    path, physics = rollout(BALL, Physics.liu(), StopRule.at_x(-0.4)), Physics.liu()
    out.publish(MultiDOFJointTrajectory())  # no joint: refused, survived
    goal.publish(goal_to_message(GOAL))

    def hits_the_goal(racket):
        ball = path.at(racket.time)
        velocity, spin = physics.racket.after(ball.velocity, ball.spin, racket)
        end = fly(np.concatenate([ball.position, velocity, spin]), GOAL.flight_time, physics.air.coefficients)
        return end[:2] == pytest.approx(GOAL.landing, abs=1e-4)  # m; stamps hold whole nanoseconds

    # the goal and the path are two topics: which comes first is open, so the path is sent until its strokes are for this goal
    until(lambda: (got and all(map(hits_the_goal, strokes_from_message(got[-1])))) or out.publish(path_to_message(path)), probe)
    rackets = strokes_from_message(got[-1])
    assert len(rackets) > 2
    assert all(racket.time > BALL.time for racket in rackets)


def a_path():
    return path_to_message(rollout(BALL, Physics.liu(), StopRule.at_x(-0.4)))


def a_goal():
    return goal_to_message(GOAL)


def with_numbers(message, number, point=-1):
    """The message with a number in the place, the velocity and the spin of one point."""
    there, moving = message.points[point].transforms[0].translation, message.points[point].velocities[0]
    there.x = there.y = moving.linear.x = moving.angular.z = number
    return message


def at(message, sec, nanosec=0, point=-1):
    message.points[point].time_from_start.sec, message.points[point].time_from_start.nanosec = sec, nanosec
    return message


def stamped(message, sec, nanosec=0):
    message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
    return message


def with_points(message, points):
    message.points = points
    return message


def without_transforms(message):
    message.points[0].transforms = []
    return message


def out_of_range(**values):
    return Failure(ValueFailure.OUT_OF_RANGE, **values)


BAD = {  # for paths and goals, from a good message, and what the refusal tells
    "NaN": (lambda m: with_numbers(m, math.nan), Failure(ValueFailure.NOT_FINITE)),
    "infinite": (lambda m: with_numbers(m, -math.inf), Failure(ValueFailure.NOT_FINITE)),
    "1e17": (lambda m: with_numbers(m, 1e17), out_of_range(value=1e17)),
    "no points": (lambda m: with_points(m, []), out_of_range(value=0.0, low=1)),
    "many points": (lambda m: with_points(m, list(m.points)[:1] * 2500), out_of_range(value=2500.0, high=MOST_PATH_POINTS)),
    "oversize": (lambda m: with_points(m, list(m.points)[:1] * 10**5), Failure(MessageFailure.TOO_LARGE)),
    "no transforms": (without_transforms, Failure(MessageFailure.INCOMPLETE_POINT)),
    "late": (lambda m: at(m, 2**31 - 1), out_of_range(value=2.0**31 - 1.0, high=FROM_START[1])),
    "early": (lambda m: at(m, -(2**31)), out_of_range(value=-(2.0**31), low=FROM_START[0])),
    "before 1970": (lambda m: stamped(m, -1), out_of_range(low=0.0, high=LARGEST_STAMP)),
    "nanoseconds": (lambda m: stamped(m, 0, 4 * 10**9), Failure(MessageFailure.BAD_STAMP, nanosec=4 * 10**9)),
}
BAD_PATHS = BAD | {"wrong order": (lambda m: with_points(m, list(m.points)[::-1]), Failure(ValueFailure.DECREASING))}
BAD_GOALS = {name: case for name, case in BAD.items() if name != "many points"} | {
    "two points": (lambda m: with_points(m, list(m.points) * 2), out_of_range(value=2.0, high=1)),
    "at once": (lambda m: at(m, 0), out_of_range(name="flight_time", value=0.0)),
    "too large": (lambda m: with_points(m, list(m.points) * 2500), Failure(MessageFailure.TOO_LARGE)),
}
EXTREME_PATHS = [
    lambda m: stamped(m, 0),
    lambda m: with_numbers(m, 100.0),
    lambda m: with_points(m, list(m.points)[:1]),
    lambda m: with_points(m, list(m.points)[:1] * 2000),  # of one time: bounces all
    lambda m: at(m, 100),
]


def test_it_lives_through_whatever_comes(start, probe, until):
    """Each bad path and goal is refused by its code, paths at the bounds are answered or refused, and the next good path is answered."""
    start("tt_racket.racket_node")
    got, statuses = [], []
    probe.create_subscription(MultiDOFJointTrajectory, "/racket/strokes", got.append, LATEST)
    probe.create_subscription(DiagnosticArray, "/diagnostics", lambda message: statuses.extend(read_status(message)), RELIABLE)
    goal = probe.create_publisher(MultiDOFJointTrajectory, "/return/goal", RELIABLE)  # volatile, as from a command line
    out = probe.create_publisher(MultiDOFJointTrajectory, "/ball/path", RELIABLE)
    until(lambda: all(p.get_subscription_count() == 1 for p in (goal, out)) and probe.count_publishers("/diagnostics") == 1, probe)

    def answers_the_next_path():
        got.clear()
        until(lambda: (got and strokes_from_message(got[-1])) or out.publish(a_path()), probe)

    for publisher, make, cases in ((out, a_path, BAD_PATHS), (goal, a_goal, BAD_GOALS)):
        for spoil, failure in cases.values():
            statuses.clear()
            message = spoil(make())
            until(lambda p=publisher, m=message, f=failure: is_told(f, statuses) or p.publish(m), probe)
        answers_the_next_path()
    for spoil in EXTREME_PATHS:
        out.publish(spoil(a_path()))
        answers_the_next_path()


def test_a_bad_parameter_ends_it_with_the_reason(start):
    node = start("tt_racket.racket_node", "--ros-args", "-p", "goal.landing_x:=0.5")
    assert node.wait(timeout=120) == 2
    check_named(node.stderr.read(), "landing_x", 0.5, 1.37, 2.74)
