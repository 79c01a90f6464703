"""Discover the running ROS graph, and list its nodes, topics and services.

Each DDS participant on this machine has a UDP port of its domain and a writer of `ros_discovery_info`, and its nodes publish on
/parameter_events. Discovery is therefore complete when as many of these writers are known as there are ports, when each participant has a
node whose name is known, and when nothing new has come for a moment. It takes 0.2 to 0.5 s, where a fixed wait would need 2 s.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import rclpy
from rclpy.node import Node
from rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden

DISCOVERY = 2.0  # s, longest wait for discovery: a participant that was just killed is forgotten after 2 s (config/fastdds.xml)
REMOTE = 1.0  # s, shortest wait if other machines may take part: they announce themselves every 0.3 s (config/fastdds.xml)
DISCOVERY_QUIET, DISCOVERY_CHECK_INTERVAL = 0.1, 0.01  # s without anything new, after which discovery may be complete; s between two checks
UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"  # name of a node whose true name has not arrived yet (rmw_dds_common)
FIRST_PORT, PER_DOMAIN, FIRST, LAST = 7400, 250, 10, 250  # ports of a domain (RTPS 2.2, 9.6.1.1); participants have two each, from FIRST on


@contextmanager
def graph(spin_time: float | None = None) -> Iterator[Node]:
    """Yield a hidden node that has discovered the ROS graph. rclpy is initialized for this context, and shut down after it.

    Args:
        spin_time: Time to wait for discovery, s; None to wait until it is complete, at most DISCOVERY s.
    """
    rclpy.init(args=[])
    node = rclpy.create_node(f"_ros2cli_{os.getpid()}", enable_rosout=False, start_parameter_services=False)
    try:
        if spin_time is None:
            discover(node)
        else:
            time.sleep(spin_time)
        yield node
    finally:
        rclpy.try_shutdown()


class Discovery:
    """Watches whether a node has discovered all participants of the ROS graph."""

    def __init__(self, node: Node) -> None:
        """Begin to watch the discovery of `node`."""
        self._node, self._begin = node, time.monotonic()
        self._seen, self._since = -1, self._begin
        self._least = REMOTE if os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET") != "LOCALHOST" else 0.0

    def is_complete(self) -> bool:
        """Return whether discovery is complete by now, or has lasted longer than DISCOVERY. To be called until it returns True."""
        now = time.monotonic()
        if (count := _endpoints(self._node)) != self._seen:
            self._seen, self._since = count, now
        if now > self._begin + DISCOVERY:
            return True
        quiet = now > self._since + DISCOVERY_QUIET and now > self._begin + self._least
        return quiet and _known_participants(self._node) >= ports(self._node.context.get_domain_id())


def discover(node: Node) -> None:
    """Wait until `node` has discovered the graph, at most DISCOVERY s."""
    discovery = Discovery(node)
    while not discovery.is_complete():
        time.sleep(DISCOVERY_CHECK_INTERVAL)


def appears(condition: Callable[[], bool]) -> bool:
    """Wait until a condition holds, at most DISCOVERY s, and return whether it does. On a busy machine discovery may be late."""
    end = time.monotonic() + DISCOVERY
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(DISCOVERY_CHECK_INTERVAL)
    return True


def ports(domain: int) -> int:
    """Return how many DDS participants of the domain with number `domain` have a UDP port on this machine."""
    first = FIRST_PORT + PER_DOMAIN * domain
    wanted = {f"{port:04X}" for port in range(first + FIRST, first + LAST, 2)}
    lines = [line for table in ("udp", "udp6") for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]]
    return len({port for line in lines if (port := line.split()[1].rpartition(":")[2]) in wanted})


def _known_participants(node: Node) -> int:
    """Return the number of discovered participants that have a node whose name is known."""
    writers = {bytes(info.endpoint_gid[:12]) for info in node.get_publishers_info_by_topic("ros_discovery_info", no_mangle=True)}
    named = [info for info in node.get_publishers_info_by_topic("/parameter_events") if info.node_name != UNKNOWN_NODE]
    return len(writers & {bytes(info.endpoint_gid[:12]) for info in named})


def _endpoints(node: Node) -> int:
    """Return the number of discovered publishers, subscribers and nodes; it changes when something new is discovered."""
    topics = node.get_topic_names_and_types()
    return sum(node.count_publishers(name) + node.count_subscribers(name) for name, _ in topics) + len(node.get_node_names())


def visible(found: Iterable[tuple[str, list[str]]], *, hidden: bool) -> dict[str, list[str]]:
    """Return topics or services as a dictionary of types by name, sorted by name.

    Args:
        found: Names of topics or services, each with its types.
        hidden: Whether to include names that have a part which begins with _.
    """
    return {name: list(types) for name, types in sorted(found) if hidden or not topic_or_service_is_hidden(name)}


def topics(node: Node, *, hidden: bool = False) -> dict[str, list[str]]:
    """Return the types of each topic that `node` has discovered, by name. hidden: whether to include hidden topics."""
    return visible(node.get_topic_names_and_types(), hidden=hidden)


def services(node: Node, *, hidden: bool = False) -> dict[str, list[str]]:
    """Return the types of each service that `node` has discovered, by name. hidden: whether to include hidden services."""
    return visible(node.get_service_names_and_types(), hidden=hidden)


def nodes(node: Node, *, hidden: bool = False) -> list[str]:
    """Return the full names of all nodes that `node` has discovered, sorted. A name that two nodes share appears twice.

    Args:
        node: The node that has discovered the graph.
        hidden: Whether to include nodes whose names begin with _.
    """
    return sorted(name for name in node.get_fully_qualified_node_names() if hidden or not topic_or_service_is_hidden(name))
