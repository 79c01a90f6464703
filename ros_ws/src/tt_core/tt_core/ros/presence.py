"""Publishing of a node's name after other nodes may have removed it from discovery."""

from __future__ import annotations

import time
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node

NAME = "_announced"  # of the node that exists for a second; ROS tools hide nodes whose names begin with _
PRESENCE_CHECK_INTERVAL = 0.25  # s between two checks
STANDSTILL = 1.0  # s between two checks, half of the DDS lease; after a longer one other nodes may have removed this one from discovery
DELAY = 1.0  # s to wait, so that DDS discovers the participant again first, which takes about 0.3 s
NAME_DURATION = 1.0  # s for which the node NAME exists, so that other nodes discover it
REACTION_PAUSE = 5.0  # s after its own announcement for which a node does not react to those of others


class Presence:
    """Makes a process publish the names of its nodes again.

    It does so after the start, after a standstill of the process, when another node disappears, and when another node publishes its names
    again.

    DDS removes a participant that is silent for longer than the lease, 2 s. When the participant continues, the others discover it and its
    endpoints again, but not the names of its nodes: a process publishes these on the topic `ros_discovery_info` only when its nodes or
    endpoints change. Therefore this class creates a second node in the process, and destroys it a second later.

    The second node has no endpoints. If publishers and subscriptions were created and destroyed instead, the discovery messages of Fast DDS
    2.14.5 would have missing sequence numbers, and after two standstills within 3 s other nodes would wait forever for earlier ones.
    """

    def __init__(self, node: Node) -> None:
        """Start to check, every PRESENCE_CHECK_INTERVAL seconds, whether the node names must be published again.

        Args:
            node: A node that is going to be spun.
        """
        self._node = node
        self._checked = time.monotonic()
        self._due, self._announced = self._checked + DELAY, float("-inf")
        self._known = set[tuple[str, str]]()  # (name, namespace)
        self._second: Any = None  # the node NAME
        node.create_timer(PRESENCE_CHECK_INTERVAL, self._check, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _check(self) -> None:
        if not self._node.context.ok():  # another callback has shut it down while this timer waited in the executor's queue
            return
        now = time.monotonic()
        names = self._node.get_node_names_and_namespaces()
        known = {(name, space) for name, space in names if not name.startswith("_")}
        if now - self._checked > STANDSTILL or self._known - known:
            self._due = now + DELAY
        elif now - self._announced > REACTION_PAUSE and any(name == NAME for name, _ in names):
            self._due = now
        self._checked, self._known = now, known
        handle = self._node.context.handle
        if self._second is None and now >= self._due and handle is not None:
            self._due, self._announced = float("inf"), now
            with handle:
                self._second = rclpy_implementation.Node(NAME, "", handle, None, False, False)
        elif self._second is not None and now - self._announced > NAME_DURATION:
            self._second.destroy_when_not_in_use()
            self._second = None
