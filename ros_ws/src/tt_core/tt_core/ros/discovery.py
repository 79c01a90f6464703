"""Who listens to a topic."""

from __future__ import annotations

from rclpy.node import Node
from rclpy.publisher import Publisher

RECORDERS = {"record", "rosbag2_recorder"}  # nodes that subscribe to whatever there is: it is not for them that one waits


def listeners(node: Node, topic: str) -> set[str]:
    """Give the names of the nodes that subscribe to a topic, without their namespaces, as far as `node` knows them."""
    return {info.node_name for info in node.get_subscriptions_info_by_topic(topic)}


def is_heard(node: Node, publisher: Publisher) -> bool:
    """Tell whether a node other than a recorder subscribes to the publisher's topic."""
    return bool(listeners(node, publisher.topic_name) - RECORDERS)
