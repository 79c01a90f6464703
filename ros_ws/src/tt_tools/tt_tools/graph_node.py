"""Topics, nodes, messages and services of the running graph, for the ros2 command.

Names that begin with _ are hidden, as are the nodes that look at the graph here.
"""

from __future__ import annotations

import itertools
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
import yaml
from rclpy.node import Node
from tt_core.errors import TtError
from tt_core.ros.node_main import run
from tt_core.ros.qos import compatible

from .packages import interface
from .record_node import ALL

DISCOVERY = 2.0  # s until all are known: with config/fastdds.xml it took up to 0.8 s between two processes of an idle machine


def _topics(node: Node) -> dict[str, list[str]]:
    return {name: list(types) for name, types in sorted(node.get_topic_names_and_types()) if "/_" not in name}


@contextmanager
def _graph() -> Iterator[Node]:
    """Yield a node that has discovered the others."""
    rclpy.init(args=[])
    node = rclpy.create_node("_ros2_graph", enable_rosout=False, start_parameter_services=False)
    try:
        time.sleep(DISCOVERY)
        yield node
    finally:
        rclpy.try_shutdown()


def topics() -> dict[str, list[str]]:
    """Return the types of each topic by its name."""
    with _graph() as node:
        return _topics(node)


def nodes() -> list[str]:
    """Return the full names of all nodes, sorted."""
    with _graph() as node:
        return sorted(name for name in node.get_fully_qualified_node_names() if "/_" not in name)


def plain(value: Any) -> Any:
    """Return a message as dictionaries, lists and numbers, which YAML can write."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, (bytes, bytearray)):
        return list(value)
    return [plain(item) for item in value] if isinstance(value, (list, tuple)) else value


class _Listener(Node):
    """Subscribes to one topic, whatever its type and quality of service."""

    def __init__(self, name: str, on_message: Callable[[Any], None], *, raw: bool = False) -> None:
        """Subscribe to `name`; raw messages are bytes. Raises TtError if nobody publishes it."""
        super().__init__("_ros2_listener", enable_rosout=False, start_parameter_services=False)
        topic, end = self.resolve_topic_name(name), time.monotonic() + 5 * DISCOVERY
        while not (offered := self.get_publishers_info_by_topic(topic)):
            if time.monotonic() > end:
                raise TtError(f"nobody publishes {topic}; there is {', '.join(_topics(self))}")
            time.sleep(0.05)
        kind = interface(offered[0].topic_type)
        self.create_subscription(kind, topic, on_message, compatible(ALL, [info.qos_profile for info in offered]), raw=raw)


def echo(topic: str, once: bool = False) -> None:
    """Print the messages of a topic as YAML documents, until it is interrupted or after the first if `once`."""

    def tell(message: Any) -> None:
        if not rclpy.ok():
            return
        print(yaml.safe_dump(plain(message), sort_keys=False, default_flow_style=None, width=140), end="---\n", flush=True)
        if once:
            rclpy.try_shutdown()

    run(lambda: _Listener(topic, tell))


def rate(topic: str, window: int) -> None:
    """Print the rate of a topic over its last `window` messages, every second until it is interrupted."""
    times: deque[float] = deque(maxlen=window + 1)

    def tell() -> None:
        gaps = [b - a for a, b in itertools.pairwise(times)]
        if not gaps or time.monotonic() - times[-1] > 1.0:
            print("no new messages", flush=True)
            return
        mean = sum(gaps) / len(gaps)
        print(f"average rate: {1.0 / mean:.3f}\n\tmin: {min(gaps):.6f}s max: {max(gaps):.6f}s window: {len(gaps)}", flush=True)

    def make() -> Node:
        node = _Listener(topic, lambda _: times.append(time.monotonic()), raw=True)
        node.create_timer(1.0, tell)
        return node

    run(make)


def call(service: str, kind: str, values: str) -> None:
    """Call a service and print its response.

    Args:
        service: Its name.
        kind: Its type, e.g. std_srvs/srv/Trigger.
        values: The request as a YAML mapping.

    Raises:
        TtError: Nobody serves it, or `values` is no request of that type.
    """
    server = interface(kind)
    try:
        request = server.Request(check_fields=True, **(yaml.safe_load(values) or {}))
    except (AttributeError, AssertionError, TypeError, yaml.YAMLError) as error:
        fields = server.Request.get_fields_and_field_types()
        raise TtError(f"{values!r} is no request of {kind}, whose fields are {fields}") from error
    rclpy.init(args=[])
    node = rclpy.create_node("_ros2_client", enable_rosout=False, start_parameter_services=False)
    try:
        client = node.create_client(server, service)
        if not client.wait_for_service(5 * DISCOVERY):
            raise TtError(f"nobody serves {service}")
        answer = client.call_async(request)
        rclpy.spin_until_future_complete(node, answer)
        print(yaml.safe_dump(plain(answer.result()), sort_keys=False), end="")
    finally:
        rclpy.try_shutdown()
