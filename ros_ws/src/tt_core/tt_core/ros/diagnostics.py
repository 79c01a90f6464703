"""Diagnostics of a node: publishing them on /diagnostics, and reading those of other nodes."""

from __future__ import annotations

import socket
import time
from collections.abc import Sequence
from enum import Enum
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node

from ..failures import Failure
from .convert import seconds
from .inputs import Input
from .qos import RELIABLE
from .terminal import Terminal

STATUS_PERIOD = 1.0  # s between two reports about the inputs, and between two repetitions of a status (REP-107)
INPUTS = "inputs"  # part that tells what a node waits for
REPEATED = "since"  # key of a repeated status: when it was first published, s
START_GRACE = 5.0  # s from the start of a node, in which a missing publisher is not reported as a warning


class Event(Enum):
    """Events of a ball on its way through the nodes. Code decides on the member; the value is a text for people."""

    FIRST_ESTIMATE = "first estimate"  # a quick estimate of position, velocity and spin was published
    MEASURED = "measured"  # the accurate estimate was published
    REFINED = "refined"  # an estimate from more images of the same ball was published
    FOLLOWED = "followed"  # the tracker has begun to follow a new ball
    PATH = "path"  # the predicted flight was published
    STROKES = "strokes"  # racket states that return the ball were published
    SWING = "swing"  # the joint motion for one of them was planned
    NO_SWING = "no swing"  # no joint motion was planned
    FIRST_COMMAND = "first command"  # the swing has begun
    BALL_OVER = "ball over"  # the simulated ball has landed or was lost
    LEARNT = "learnt"  # the coefficients of the physics were corrected


class ReceivedStatus(NamedTuple):
    """A diagnostic status that was received.

    Attributes:
        time: Stamp of the message, s.
        name: Name of the node, followed by ": PART" if the status is about a part of it.
        message: What has happened, for people.
        values: All values by their keys.
    """

    time: float
    name: str
    message: str
    values: dict[str, str]

    @property
    def event(self) -> Event | None:
        """The event that the status is about, or None if it is about none."""
        return Event.__members__.get(self.values.get("event", ""))


class Status:
    """Publisher of the diagnostics of one node.

    Each status is repeated once a second, so that a tool which starts later shows it and sees that the node is alive. A repeated status has
    the additional key REPEATED. A repeated event has this key only, so that nobody takes it for a second event.

    Attributes:
        terminal: Writes lines of the node to the terminal.
    """

    def __init__(self, node: Node, hardware: str = "") -> None:
        """Start to publish; until the node publishes a status of its own, its status is "started".

        Args:
            node: The node.
            hardware: Name of what the node drives or simulates, the `hardware_id` of every status; empty for the name of this computer.
        """
        self._node, self._hardware, self.terminal = node, hardware or socket.gethostname(), Terminal(node)
        self._name = node.get_fully_qualified_name().lstrip("/")  # "arm", or "robot1/arm" in a namespace
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", RELIABLE)
        self._last: dict[str, DiagnosticStatus] = {}  # what is repeated, by part
        self._keep("", self._status("", "started", DiagnosticStatus.OK, {}))
        node.create_timer(STATUS_PERIOD, self._repeat, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def publish(
        self,
        what: Event | str,
        *,
        part: str = "",
        stamp: float | None = None,
        warn: bool = False,
        error: bool = False,
        reason: Failure | None = None,
        **values: object,
    ) -> None:
        """Publish one status.

        Args:
            what: What has happened. An event is also added to the values, with the key `event`.
            part: Part of the node that the status is about; empty for the whole node.
            stamp: Time of the last frame that the result is based on, s. If given, the status holds the latency since then.
            warn: Whether the status is a warning: what is wrong may pass by itself.
            error: Whether it is an error, which a person has to mend.
            reason: Why something was not done. The status holds its sentence as `reason`, its code as `code`, and its numbers by name.
            values: Other values to publish, by key.
        """
        if stamp is not None:
            latency = self._node.get_clock().now().nanoseconds * 1e-9 - stamp
            values = {"latency_ms": f"{1e3 * latency:.3f}", "stamp": f"{stamp:.9f}", **values}
        if reason is not None:
            values = {"reason": reason, "code": reason.code.name, **reason.values, **values}
        level = DiagnosticStatus.ERROR if error else DiagnosticStatus.WARN if warn else DiagnosticStatus.OK
        if isinstance(what, Event):
            self._send(part, what.value, level, {"event": what.name, **values})
        else:
            self._send(part, what, level, values)

    def wait_for(self, inputs: Sequence[Input]) -> None:
        """Publish once a second from now on whether all inputs have a publisher, as the status "NODE: inputs".

        Args:
            inputs: The inputs that the node needs. The status holds the number of publishers of each by its topic.
        """
        warn_from = time.monotonic() + START_GRACE

        def report() -> None:
            waiting = [one.topic for one in inputs if not one.publishers]
            message = f"waiting for a publisher of {', '.join(waiting)}" if waiting else "ready"
            level = DiagnosticStatus.WARN if waiting and time.monotonic() > warn_from else DiagnosticStatus.OK
            self._send(INPUTS, message, level, {one.topic: one.publishers for one in inputs})

        self._node.create_timer(STATUS_PERIOD, report, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _send(self, part: str, message: str, level: bytes, values: dict[str, object]) -> None:
        status = self._status(part, message, level, values)
        self._publish([status])
        if part != INPUTS:  # these are published once a second anyway
            self._keep(part, status)

    def _status(self, part: str, message: str, level: bytes, values: dict[str, object]) -> DiagnosticStatus:
        return DiagnosticStatus(
            level=level,
            name=f"{self._name}: {part}" if part else self._name,
            message=message,
            hardware_id=self._hardware,
            values=[KeyValue(key=k, value=str(v)) for k, v in values.items()],
        )

    def _keep(self, part: str, status: DiagnosticStatus) -> None:
        """Make a status the one that is repeated for its part."""
        since = KeyValue(key=REPEATED, value=f"{self._node.get_clock().now().nanoseconds * 1e-9:.3f}")
        kept = DiagnosticStatus(level=status.level, name=status.name, message=status.message, hardware_id=status.hardware_id)
        kept.values = [since] if any(value.key == "event" for value in status.values) else [since, *status.values]
        self._last[part] = kept

    def _repeat(self) -> None:
        """Publish the last status of every part again."""
        self._publish(list(self._last.values()))

    def _publish(self, statuses: list[DiagnosticStatus]) -> None:
        array = DiagnosticArray(status=statuses)
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)


def _level(level: bytes | int) -> bytes:
    """Return the level of a status as ROS has it; a message of a bag has a number."""
    return level if isinstance(level, bytes) else bytes([int(level)])


def read_status(message: DiagnosticArray) -> list[ReceivedStatus]:
    """Return all statuses of a message except repeated ones."""
    return [received for received, _ in _read(message)]


def read_warnings(message: DiagnosticArray) -> list[ReceivedStatus]:
    """Return all statuses of a message that are warnings or errors, except repeated ones."""
    return [received for received, level in _read(message) if level != DiagnosticStatus.OK]


def _read(message: DiagnosticArray) -> list[tuple[ReceivedStatus, bytes]]:
    """Return the statuses of a message that are not repeated ones, and the level of each."""
    time = seconds(message.header.stamp)
    received = [(ReceivedStatus(time, s.name, s.message, {v.key: v.value for v in s.values}), _level(s.level)) for s in message.status]
    return [(status, level) for status, level in received if REPEATED not in status.values]
