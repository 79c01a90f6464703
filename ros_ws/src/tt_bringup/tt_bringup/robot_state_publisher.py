"""Start the ROS node robot_state_publisher, which publishes /tf and /tf_static; end at once if it is not installed.

It needs the robot description (URDF) as a parameter when it starts. Ours is known only when arm_node runs and publishes it.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import rclpy
from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String
from tt_core.ros.qos import LATCHED
from tt_core.start import default_signals

PACKAGE = "robot_state_publisher"


def wait_for_description() -> str:
    """Wait for a message on the topic robot_description, without a time limit, and return its text, the URDF."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("wait_for_description", enable_rosout=False, start_parameter_services=False)
    received: list[String] = []
    node.create_subscription(String, "robot_description", received.append, LATCHED)
    while not received:
        rclpy.spin_once(node, timeout_sec=1.0)
    node.destroy_node()
    rclpy.try_shutdown()
    return str(received[0].data)


def main() -> int:
    """Replace this process by robot_state_publisher; return the exit code 0 if it is not installed."""
    default_signals()
    try:
        program = Path(get_package_prefix(PACKAGE)) / "lib" / PACKAGE / PACKAGE
    except PackageNotFoundError:
        print(f"{PACKAGE} is not installed: nobody publishes /tf", flush=True)
        return 0
    description = wait_for_description()
    file = os.memfd_create("robot_description", 0)  # a file in memory, which the program inherits and which ends with it
    os.write(file, json.dumps({"/**": {"ros__parameters": {"robot_description": description}}}).encode())  # JSON is YAML
    arguments = sys.argv[1:] if "--ros-args" in sys.argv else [*sys.argv[1:], "--ros-args"]
    os.execv(program, [str(program), *arguments, "--params-file", f"/proc/self/fd/{file}"])
