"""Publishes joint states and commands at 500 Hz for the seconds given, and prints the longest time in publish() (s); or only listens."""

import sys
import time

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from tt_core.ros.node_main import run
from tt_core.ros.qos import LATEST, RELIABLE

TICK = 0.002  # s
TOPICS = ((JointState, "joint_states", RELIABLE), (Float64MultiArray, "arm_velocity_controller/commands", LATEST))


def publish(node: Node, duration: float) -> float:
    publishers = [node.create_publisher(*topic) for topic in TOPICS]
    messages = [
        JointState(name=[f"joint_{i}" for i in range(7)], position=[0.0] * 7, velocity=[0.0] * 7),
        Float64MultiArray(data=[0.0] * 7),
    ]
    while not all(publisher.get_subscription_count() for publisher in publishers):
        time.sleep(0.05)
    print("matched", flush=True)
    due, end, longest = time.monotonic(), time.monotonic() + duration, 0.0
    while due < end:
        for publisher, message in zip(publishers, messages, strict=True):
            begun = time.monotonic()
            publisher.publish(message)
            longest = max(longest, time.monotonic() - begun)
        due += TICK
        time.sleep(max(0.0, due - time.monotonic()))
    return longest


def listen() -> Node:
    node = rclpy.create_node("listen", enable_rosout=False)
    for kind, name, qos in TOPICS:
        node.create_subscription(kind, name, lambda _: None, qos)
    return node


if __name__ == "__main__":
    if len(sys.argv) == 1:
        run(listen)
    else:
        rclpy.init(args=[])
        print(publish(rclpy.create_node("publish", enable_rosout=False), float(sys.argv[1])))
