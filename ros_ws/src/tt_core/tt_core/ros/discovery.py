"""Subscribers of a topic, as far as a node has discovered them."""

from __future__ import annotations

from rclpy.node import Node
from rclpy.publisher import Publisher

RECORDERS = {"record", "rosbag2_recorder"}  # nodes that subscribe to all topics; they are ignored when waiting for consumers


def listeners(node: Node, topic: str) -> set[str]:
    """Return the names of the nodes that subscribe to a topic, without their namespaces, as far as `node` has discovered them."""
    return {info.node_name for info in node.get_subscriptions_info_by_topic(topic)}


def is_heard(node: Node, publisher: Publisher) -> bool:
    """Tell whether any node that is no recorder subscribes to the publisher's topic, as far as `node` has discovered them."""
    return publisher.get_subscription_count() > 0 and bool(listeners(node, publisher.topic_name) - RECORDERS)
