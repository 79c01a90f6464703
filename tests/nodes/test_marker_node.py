"""The markers live through whatever comes, and robot_state_publisher of ROS gets the description where it is installed."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import MultiDOFJointTrajectory
from tt_arm.model import ArmModel
from tt_core.physics import Physics
from tt_core.ros.convert import ball_to_message, path_to_message
from tt_core.ros.qos import LATCHED, RELIABLE
from tt_core.states import BallState
from tt_predict.rollout import StopRule, rollout, thinned
from visualization_msgs.msg import Marker, MarkerArray

OTHER = """<robot name="post"><link name="table"><visual><geometry><box size="1 1 1"/></geometry></visual></link></robot>"""


def test_nonsense_is_survived_and_stale_markers_are_deleted(start, probe, until):
    start("tt_bringup.marker_node")
    received = []
    probe.create_subscription(MarkerArray, "/markers", lambda m: received.extend(m.markers), RELIABLE)
    robot, joints = probe.create_publisher(String, "/robot_description", LATCHED), probe.create_publisher(JointState, "/joint_states", 10)
    balls = probe.create_publisher(Odometry, "/ball/measured", RELIABLE)
    paths = probe.create_publisher(MultiDOFJointTrajectory, "/ball/path", RELIABLE)
    outputs = (robot, joints, balls, paths)
    until(lambda: all(out.get_subscription_count() == 1 for out in outputs) and received, probe)

    robot.publish(String(data="no URDF"))
    joints.publish(JointState(name=["s1"], position=[float("nan")]))
    balls.publish(Odometry())
    paths.publish(MultiDOFJointTrajectory(joint_names=["ball"]))
    now = probe.get_clock().now().nanoseconds * 1e-9
    ball = BallState(now, np.array([2.3, 0.76, 0.3]), np.array([-5.0, 0.0, 1.5]), np.zeros(3), 1e-6 * np.eye(9))
    balls.publish(ball_to_message(ball))
    until(
        lambda: seen(received, "path/ahead") or paths.publish(path_to_message(thinned(rollout(ball, Physics.liu(), StopRule.at_x(0.0))))),
        probe,
    )
    until(lambda: any(m.ns == "path/ahead" and m.action == Marker.DELETE for m in received), probe)

    robot.publish(String(data=OTHER))
    until(lambda: seen(received, "arm/table/0") and any(m.ns == "arm/racket/0" and m.action == Marker.DELETE for m in received), probe)


def seen(markers, name):
    return any(m.ns == name and m.action == Marker.ADD for m in markers)


def fake_package(folder):
    """A package robot_state_publisher whose program keeps its parameter file and its arguments."""
    program = folder / "lib" / "robot_state_publisher" / "robot_state_publisher"
    program.parent.mkdir(parents=True)
    program.write_text(f'#!/bin/sh\nfor last; do :; done\ncp "$last" {folder}/parameters.yaml\necho "$@" >{folder}/arguments\n')
    program.chmod(0o755)
    index = folder / "share" / "ament_index" / "resource_index" / "packages"
    index.mkdir(parents=True)
    (index / "robot_state_publisher").touch()


@pytest.mark.parametrize("is_installed", [True, False])
def test_robot_state_publisher_gets_the_description(ros, probe, until, tmp_path, is_installed):
    environment = dict(os.environ)
    if is_installed:
        fake_package(tmp_path)
        environment["AMENT_PREFIX_PATH"] = f"{tmp_path}:{environment['AMENT_PREFIX_PATH']}"
    description = ArmModel.pa10().placed_description
    probe.create_publisher(String, "/red/robot_description", LATCHED).publish(String(data=description))
    words = ["--ros-args", "-r", "__ns:=/red", "-r", "__node:=robot_state_publisher"]
    command = [sys.executable, "-m", "tt_core.start", "tt_bringup.robot_state_publisher", *words]
    process = subprocess.Popen(command, env=environment)
    try:
        until(lambda: process.poll() is not None, probe)
    finally:
        process.kill()
    assert process.returncode == 0
    if is_installed:
        content = yaml.safe_load(Path(tmp_path / "parameters.yaml").read_text())
        assert content["/**"]["ros__parameters"]["robot_description"] == description
        assert (tmp_path / "arguments").read_text().startswith(" ".join(words))
