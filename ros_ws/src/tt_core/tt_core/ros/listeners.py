"""Who listens to a publisher."""

from __future__ import annotations

from rclpy.node import Node
from rclpy.publisher import Publisher

RECORDERS = {"record", "rosbag2_recorder"}  # nodes that subscribe to whatever there is: it is not for them that one waits


def is_heard(node: Node, publisher: Publisher) -> bool:
    """Whether a node other than a recorder subscribes to the publisher's topic."""
    return any(info.node_name not in RECORDERS for info in node.get_subscriptions_info_by_topic(publisher.topic_name))
