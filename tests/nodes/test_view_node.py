"""The view in a browser: it loads, its buttons act in the graph, and a goal that is clicked is the goal of the strokes."""

import re
import time

import numpy as np
import pytest
from browser import CHROMIUM, opened
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import MultiDOFJointTrajectory
from tt_bringup.view.page import EYE, FIELD_OF_VIEW, TARGET
from tt_core.physics import Physics
from tt_core.ros.convert import ball_from_message, goal_from_message, path_from_message, seconds, strokes_from_message
from tt_core.ros.qos import LATCHED, LATEST, RELIABLE, TRUTH
from tt_predict.rollout import StopRule, rollout

GRAPH = (("tt_sim.sim_node", ()), ("tt_vision.estimate_node", ()), ("tt_predict.predict_node", ("-r", "ball/state:=ball/measured")))
GRAPH += (("tt_racket.racket_node", ()),)
SLOW = ("-p", "use_sim_time:=true")


def address(process, bound=120.0):
    """The address that the view has printed."""
    end, printed = time.monotonic() + bound, ""
    while not (found := re.search(r"http://\S+", printed)):
        assert time.monotonic() < end and process.poll() is None, printed
        time.sleep(0.1)
        printed += process.stderr.read()
    return found[0]


def landing(racket, path):
    """Where a stroke sends the ball of a path, (2,) m."""
    physics = Physics.liu()
    ball = path.at(racket.time)
    velocity, spin = physics.racket.after(ball.velocity, ball.spin, racket)
    after = type(ball)(ball.time, ball.position, velocity, spin)
    return rollout(after, physics, StopRule.at_landing()).end.position[:2]


def answer_to(act, answers):
    """Return a condition for `until`: there are answers to what a user does on the page by `act()`, now and every 10 s until then.

    A page that the browser has just loaded may not listen to clicks yet, and the first ball may pass before the simulator and
    estimate_node have discovered each other.
    """
    due = time.monotonic()

    def has_answers():
        nonlocal due
        if not answers and time.monotonic() >= due:
            act()
            due = time.monotonic() + 10.0
        return answers

    return has_answers


@pytest.mark.skipif(CHROMIUM is None, reason="there is no program chromium; install it: apt-get install chromium")
def test_the_page_drives_the_graph(start, probe, until):
    for module, arguments in GRAPH:
        start(module, "--ros-args", *SLOW, *arguments, *(("-p", "rtf:=0.5") if module.startswith("tt_sim") else ()))
    view = start("tt_bringup.view_node", "--ros-args", *SLOW, "-p", "port:=0")
    truth, goals, paths, strokes, joints = [], [], [], [], []
    kind = MultiDOFJointTrajectory
    probe.create_subscription(Odometry, "/sim/ball", truth.append, TRUTH)
    probe.create_subscription(kind, "/return/goal", goals.append, LATCHED)
    probe.create_subscription(kind, "/ball/path", paths.append, RELIABLE)
    probe.create_subscription(kind, "/racket/strokes", strokes.append, LATEST)
    probe.create_subscription(JointState, "/joint_states", lambda m: joints.append(seconds(m.header.stamp)), RELIABLE)
    until(lambda: probe.count_subscribers("/ball/path") == 3 and probe.count_subscribers("/ball/measured") == 2, probe)
    until(lambda: probe.count_subscribers("/return/goal") == 3 and probe.count_subscribers("/camera/left/image_raw") == 2, probe)
    with opened(address(view)) as (page, errors):
        box = page.locator("canvas").first.bounding_box()
        until(answer_to(lambda: page.mouse.click(*pixel(np.array([1.9, 0.6, 0.0]), box)), goals), probe)
        assert goal_from_message(goals[0]).landing == pytest.approx([1.9, 0.6], abs=0.02)  # m; a pixel shows about 5 mm there

        launch = page.get_by_role("button", name="Launch a ball")
        until(answer_to(launch.click, strokes), probe)
        until(lambda: truth, probe)
        assert ball_from_message(truth[0]).position[0] > 2.0  # m; it has just been launched
        path, rackets = path_from_message(paths[-1]), strokes_from_message(strokes[-1])
        goal = goal_from_message(goals[-1])
        # m; thinning the path moves the landing by 1e-7 m, and a relaxed goal would move it by centimetres
        assert min(np.linalg.norm(landing(racket, path) - goal.landing) for racket in rackets) < 1e-3

        page.get_by_role("button", name="Pause").click()
        until(lambda: standing(joints, probe), probe)
        page.get_by_role("button", name="Step").click()
        before = joints[-1]
        until(lambda: joints[-1] > before, probe)
        page.get_by_role("button", name="Go on").click()
        until(lambda: joints[-1] > before + 0.5, probe)
        assert not errors


def pixel(place, box):
    """Where the first view of the page shows a place (3,) m of `table`: x and y in pixels of the window."""
    ahead = np.array(TARGET) - EYE
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    axes = np.array([axis / np.linalg.norm(axis) for axis in (right, np.cross(ahead, right), ahead)])
    x, y, depth = axes @ (place - EYE)
    focal = 0.5 * box["height"] / np.tan(0.5 * FIELD_OF_VIEW)
    return box["x"] + 0.5 * box["width"] + focal * x / depth, box["y"] + 0.5 * box["height"] + focal * y / depth


def standing(joints, probe):
    """Whether no joint state has come for 0.2 s."""
    count, end = len(joints), time.monotonic() + 0.2
    while time.monotonic() < end:
        probe.executor.spin_once(timeout_sec=0.05)
    return len(joints) == count
