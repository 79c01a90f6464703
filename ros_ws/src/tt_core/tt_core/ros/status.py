"""What a stage tells about itself on /diagnostics."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from .convert import seconds
from .qos import RELIABLE


class Status:
    """One stage: `tell` publishes one status with the latency since `stamp` (s), the time of the last frame that the result rests on.

    part: of the node, that the status is about, if not about the whole.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", RELIABLE)

    def tell(self, message: str, *, part: str = "", stamp: float | None = None, warn: bool = False, **values: object) -> None:
        now = self._node.get_clock().now()
        if stamp is not None:
            values = {"latency_ms": f"{1e3 * (now.nanoseconds * 1e-9 - stamp):.3f}", "stamp": f"{stamp:.9f}", **values}
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN if warn else DiagnosticStatus.OK,
            name=f"{self._node.get_name()}: {part}" if part else self._node.get_name(),
            message=message,
            values=[KeyValue(key=k, value=str(v)) for k, v in values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = now.to_msg()
        self._publisher.publish(array)


def read_status(message: DiagnosticArray) -> list[tuple[float, str, str, dict[str, str]]]:
    """(time s, name, message, values) of each status."""
    time = seconds(message.header.stamp)
    return [(time, s.name, s.message, {v.key: v.value for v in s.values}) for s in message.status]
