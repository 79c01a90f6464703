"""A node that has discovered the running graph, and what it sees.

A participant of DDS on this machine has a UDP port of its domain and a writer of `ros_discovery_info`, and its nodes publish on
/parameter_events. So discovery is complete when there are as many of these writers as ports, when the nodes of each are known by name, and
when nothing new has come for a moment. It takes 0.2 to 0.5 s, where a fixed wait would need 2 s.
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

DISCOVERY = 2.0  # s for all participants to be discovered: one that has just been killed is forgotten after 2 s (config/fastdds.xml)
REMOTE = 1.0  # s, at least, where participants of other machines may be: they announce themselves every 0.3 s (config/fastdds.xml)
QUIET, POLL = 0.1, 0.01  # s without anything new; between two looks
UNKNOWN = "_NODE_NAME_UNKNOWN_"  # of a node whose name has not arrived yet (rmw_dds_common)
PORT, PER_DOMAIN, FIRST, LAST = 7400, 250, 10, 250  # ports of a domain (RTPS 2.2, 9.6.1.1); of participants from FIRST on, two for each


@contextmanager
def graph(spin_time: float | None = None) -> Iterator[Node]:
    """Yield a node that has discovered the others.

    Args:
        spin_time: s, how long to wait; until all on this machine are discovered if None.
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
    """Tells whether a node has discovered the graph."""

    def __init__(self, node: Node) -> None:
        self._node, self._begin = node, time.monotonic()
        self._seen, self._since = -1, self._begin
        self._least = REMOTE if os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET") != "LOCALHOST" else 0.0

    def is_complete(self) -> bool:
        """Look again."""
        now = time.monotonic()
        if (count := _endpoints(self._node)) != self._seen:
            self._seen, self._since = count, now
        if now > self._begin + DISCOVERY:
            return True
        quiet = now > self._since + QUIET and now > self._begin + self._least
        return quiet and _known_participants(self._node) >= ports(self._node.context.get_domain_id())


def discover(node: Node) -> None:
    """Wait until `node` has discovered the graph."""
    discovery = Discovery(node)
    while not discovery.is_complete():
        time.sleep(POLL)


def appears(condition: Callable[[], bool]) -> bool:
    """Return whether a condition holds within DISCOVERY: a busy machine may be late with what the graph has."""
    end = time.monotonic() + DISCOVERY
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(POLL)
    return True


def ports(domain: int) -> int:
    """Return how many participants of a domain have a port on this machine."""
    first = PORT + PER_DOMAIN * domain
    wanted = {f"{port:04X}" for port in range(first + FIRST, first + LAST, 2)}
    lines = [line for table in ("udp", "udp6") for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]]
    return len({port for line in lines if (port := line.split()[1].rpartition(":")[2]) in wanted})


def _known_participants(node: Node) -> int:
    """Return how many participants are discovered, of each of which a node is known by name."""
    writers = {bytes(info.endpoint_gid[:12]) for info in node.get_publishers_info_by_topic("ros_discovery_info", no_mangle=True)}
    named = [info for info in node.get_publishers_info_by_topic("/parameter_events") if info.node_name != UNKNOWN]
    return len(writers & {bytes(info.endpoint_gid[:12]) for info in named})


def _endpoints(node: Node) -> int:
    """Return a number that changes when something is discovered."""
    topics = node.get_topic_names_and_types()
    return sum(node.count_publishers(name) + node.count_subscribers(name) for name, _ in topics) + len(node.get_node_names())


def visible(found: Iterable[tuple[str, list[str]]], *, hidden: bool) -> dict[str, list[str]]:
    """Return the types of topics or services by name, sorted, without hidden ones unless `hidden`."""
    return {name: list(types) for name, types in sorted(found) if hidden or not topic_or_service_is_hidden(name)}


def topics(node: Node, *, hidden: bool = False) -> dict[str, list[str]]:
    """Return the types of each topic by its name."""
    return visible(node.get_topic_names_and_types(), hidden=hidden)


def services(node: Node, *, hidden: bool = False) -> dict[str, list[str]]:
    """Return the types of each service by its name."""
    return visible(node.get_service_names_and_types(), hidden=hidden)


def nodes(node: Node, *, hidden: bool = False) -> list[str]:
    """Return the full names of all nodes, sorted; a name that two nodes have stands twice."""
    return sorted(name for name in node.get_fully_qualified_node_names() if hidden or not topic_or_service_is_hidden(name))
