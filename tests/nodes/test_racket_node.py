"""The node is wired: a path and a goal in, strokes out, nonsense survived."""

import numpy as np
import pytest
from trajectory_msgs.msg import MultiDOFJointTrajectory
from tt_core.flight import fly
from tt_core.physics import Physics
from tt_core.ros.convert import goal_to_message, path_to_message, strokes_from_message
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


def test_a_bad_parameter_ends_it_with_the_reason(start):
    node = start("tt_racket.racket_node", "--ros-args", "-p", "goal.landing_x:=0.5")
    assert node.wait(timeout=30) == 2
    assert "landing_x = 0.5 is outside [1.37, 2.74]" in node.stderr.read()
