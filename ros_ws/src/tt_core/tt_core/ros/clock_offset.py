"""Comparison of a node's clock with the clocks of the nodes whose stamps it uses.

A node asks for the time on `clock_offset/ping`. Every node that stamps data answers on `clock_offset/pong`. Both topics carry
sensor_msgs/TimeReference:

| field | ping | pong |
|---|---|---|
| header.stamp | t1, clock of the node that asks | t2, clock of the node that answers |
| source | name of the node that asks | name of the node that answers |
| time_ref | | t1 |
| header.frame_id | | name of the node that asks |
"""

from __future__ import annotations

import json
from collections import deque

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from sensor_msgs.msg import TimeReference

from ..clock_offsets import ClockOffset, ClockOffsets
from ..errors import TtError, check_range
from .convert import seconds
from .diagnostics import Status
from .inputs import Input, MessageForm
from .qos import SENSOR

PING, PONG = "clock_offset/ping", "clock_offset/pong"
QUESTION_PERIOD = 0.25  # s between two questions
OFFSET_REPORT_PERIOD = 1.0  # s between two reports
CLOCK_FORM = MessageForm(TimeReference, 1024)
PENDING = 16  # last questions whose answers are accepted, those of 4 s


def answer_clock_pings(node: Node) -> None:
    """Make `node` answer all questions for its time (pings), with the clock by which it stamps its data."""
    pongs = node.create_publisher(TimeReference, PONG, SENSOR)

    def answer(ping: TimeReference) -> None:
        pong = TimeReference(time_ref=ping.header.stamp, source=node.get_name())
        pong.header.frame_id = ping.source
        pong.header.stamp = node.get_clock().now().to_msg()
        pongs.publish(pong)

    Input(node, CLOCK_FORM, PING, answer, SENSOR, refused=lambda error: _warn(node, error))


class ClockMonitor:
    """Measures the clock offsets of all nodes that answer pings, and publishes them on /diagnostics.

    With `use_sim_time` all nodes follow /clock, so the monitor neither asks nor publishes.
    """

    def __init__(self, node: Node, status: Status, bound: float = 0.002) -> None:
        """Start to ask for the time.

        Args:
            node: The node whose clock is compared with the others.
            status: Diagnostics of the node, where the offsets are published once a second.
            bound: s, offset above which the status is a warning.

        Raises:
            OutOfRange: `bound` is negative or above 10 s.
        """
        check_range("clock offset bound", bound, 0.0, 10.0)
        self._node, self._status, self._bound = node, status, bound
        self._offsets, self._asked = ClockOffsets(), deque[tuple[int, int]](maxlen=PENDING)
        if node.get_parameter("use_sim_time").value:
            return
        self._pings = node.create_publisher(TimeReference, PING, SENSOR)
        Input(node, CLOCK_FORM, PONG, self._on_pong, SENSOR, refused=lambda error: _warn(node, error))
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(QUESTION_PERIOD, self._ask, clock=steady)
        node.create_timer(OFFSET_REPORT_PERIOD, self._report, clock=steady)

    def worst(self) -> ClockOffset | None:
        """Return the clock with the largest offset minus uncertainty, or None if no node has answered in the last 10 s."""
        return self._offsets.worst(self._now())

    def _now(self) -> float:
        return float(self._node.get_clock().now().nanoseconds * 1e-9)

    def _ask(self) -> None:
        ping = TimeReference(source=self._node.get_name())
        ping.header.stamp = self._node.get_clock().now().to_msg()
        self._asked.append((ping.header.stamp.sec, ping.header.stamp.nanosec))
        self._pings.publish(ping)

    def _on_pong(self, pong: TimeReference) -> None:
        """Take the answer to one of our last questions. Answers to other nodes, and to questions that were not asked, are ignored."""
        now = self._now()
        if pong.header.frame_id == self._node.get_name() and (pong.time_ref.sec, pong.time_ref.nanosec) in self._asked:
            self._offsets.add(pong.source, seconds(pong.time_ref), seconds(pong.header.stamp), now)

    def _report(self) -> None:
        worst = self.worst()
        if worst is None:
            return
        known = self._offsets.all(self._now())
        milliseconds = {clock.source: (round(1e3 * clock.offset, 3), round(1e3 * clock.uncertainty, 3)) for clock in known}
        self._status.publish(
            "clock offsets",
            warn=worst.least > self._bound,
            worst=worst.source,
            least_ms=f"{1e3 * worst.least:.3f}",
            offset_and_uncertainty_ms=json.dumps(milliseconds),
        )


def _warn(node: Node, error: TtError) -> None:
    node.get_logger().warning(str(error), throttle_duration_sec=1.0)
