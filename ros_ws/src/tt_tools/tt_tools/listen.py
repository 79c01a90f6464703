"""Listen to one topic, and print its messages, rate, delay or bandwidth. What is printed is worded as in ros2cli."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Collection, Sequence
from typing import Any, NamedTuple

import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.time import Time
from rclpy.topic_endpoint_info import TopicEndpointInfo
from tt_core.errors import TtError
from tt_core.ros.node_main import run
from tt_core.ros.qos import compatible

from .errors import GraphError
from .graph import appears, discover
from .message_text import TextOptions, to_csv, to_yaml
from .packages import interface
from .qos import KEEP_ALL, QosWords

REPORT = 1.0  # s between two reports
TOPIC_CHECK_INTERVAL = 0.05  # s between two checks for a topic


class _Listener(Node):
    """Node that subscribes to one topic of any type and quality of service."""

    def __init__(self, topic: str, on_data: Callable[[bytes], None], *, kind: str = "", qos: QosWords | None = None, wait: bool = False):
        """Subscribe.

        Args:
            topic: Name of the topic.
            on_data: Called with each serialized message.
            kind: Message type; "" for the type that the topic has in the graph.
            qos: Quality-of-service options of the command line; None for a profile that suits all publishers.
            wait: Whether to wait until the topic exists.

        Raises:
            GraphError: The topic has no type, or several.
            NotFound: The type is not installed.
        """
        super().__init__("_ros2cli_listener", enable_rosout=False, start_parameter_services=False)
        discover(self)
        name = self.resolve_topic_name(topic)
        appears(lambda: bool(kind or self._kinds(name)))
        kinds = [kind] if kind else self._kinds(name)
        if not kinds:
            print(f"WARNING: topic [{topic}] does not appear to be published yet", flush=True)
            while wait and not kinds:
                time.sleep(TOPIC_CHECK_INTERVAL)
                kinds = self._kinds(name)
        if not kinds:
            raise GraphError("Could not determine the type for the passed topic")
        if len(kinds) > 1:
            raise GraphError(f"Cannot echo topic '{topic}', as it contains more than one type: [{', '.join(kinds)}]")
        self.kind = interface(kinds[0])
        offered = [info.qos_profile for info in self.get_publishers_info_by_topic(name)]
        profile = qos.profile(offered) if qos else compatible(KEEP_ALL, offered)
        self.create_subscription(self.kind, name, on_data, profile, raw=True)
        _warn_of_mismatch(topic, profile, self.get_publishers_info_by_topic(name))

    def _kinds(self, topic: str) -> list[str]:
        return dict(self.get_topic_names_and_types()).get(topic, [])

    def message(self, data: bytes) -> Any:
        """Return the message that serialized bytes hold."""
        return deserialize_message(data, self.kind)


def _warn_of_mismatch(topic: str, profile: QoSProfile, publishers: Collection[TopicEndpointInfo]) -> None:
    lower = [info for info in publishers if compatible(profile, [info.qos_profile]) != compatible(profile, [])]
    for info in lower:
        print(f"WARNING: /{info.node_name} offers {topic} with less than the quality of service asked for; nothing will come from it")


class EchoOptions(NamedTuple):
    """Options of `ros2 topic echo`: which messages are printed, and how.

    Attributes:
        text: How messages are written as text.
        csv: Whether messages are printed as values separated by commas, instead of YAML.
        field: Part of the message that is printed, e.g. "poses[0].position.x"; "" for the whole message.
        raw: Whether the serialized bytes are printed instead of text.
        filter: Python expression of `m`, which is the message or its part. Only messages for which it is true are printed; "" for all.
        once: Whether to end after the first message that was printed.
        timeout: Time after which to end, s; None for no limit.
    """

    text: TextOptions = TextOptions()
    csv: bool = False
    field: str = ""
    raw: bool = False
    filter: str = ""
    once: bool = False
    timeout: float | None = None


def message_part(message: Any, field: str) -> Any:
    """Return a part of a message.

    Args:
        message: A message of any type.
        field: Names of fields with dots between them and [i] for an element, e.g. "poses[0].position.x"; "" for the message itself.

    Raises:
        GraphError: The message has no such part.
    """
    for step in field.replace("[", ".[").split(".") if field else ():
        try:
            message = message[int(step[1:-1])] if step.startswith("[") else getattr(message, step)
        except (AttributeError, IndexError, ValueError, TypeError) as error:
            raise GraphError(f"Invalid field '{field}': {error}") from error
    return message


def echo(topic: str, kind: str, qos: QosWords, options: EchoOptions) -> None:
    """Print the messages of a topic until the options or the user end it.

    Args:
        topic: Name of the topic.
        kind: Message type; "" for the type that the topic has in the graph.
        qos: Quality-of-service options of the command line.
        options: Which messages are printed, and how.

    Raises:
        TtError: The topic or the field does not exist, or the filter fails.
    """
    listeners: list[_Listener] = []

    def print_message(data: bytes) -> None:
        if not rclpy.ok():
            return
        if options.raw:
            print(data, end="\n---\n", flush=True)
        else:
            shown = message_part(listeners[0].message(data), options.field)
            if options.filter and not evaluate_expression(options.filter, shown):
                return
            print(text(shown), end="" if options.csv else "---\n", flush=True)
        if options.once:
            rclpy.try_shutdown()

    def text(shown: Any) -> str:
        if not hasattr(shown, "get_fields_and_field_types"):
            return f"{shown}\n"
        return to_csv(shown, options.text) + "\n" if options.csv else to_yaml(shown, options.text)

    def make() -> Node:
        listeners.append(_Listener(topic, print_message, kind=kind, qos=qos))
        if options.timeout is not None:
            listeners[0].create_timer(options.timeout, rclpy.try_shutdown)
        return listeners[0]

    _run(make)


def evaluate_expression(expression: str, message: Any) -> Any:
    """Return the value of a Python expression in which `m` is the message. Raises TtError if the evaluation fails."""
    try:
        return eval(expression, {}, {"m": message})  # the expression comes from the user's own command line
    except Exception as error:
        raise TtError(f"{expression!r} fails: {error}") from error


def _run(make: Callable[[], Node]) -> None:
    """Make a node and spin it. As in ros2cli, the exit code is 1 if it cannot be made."""
    try:
        run(make)
    except SystemExit as ended:
        raise SystemExit(bool(ended.code)) from None


class Statistics(NamedTuple):
    """Mean, smallest value, largest value and standard deviation of some values, in their unit."""

    mean: float
    least: float
    largest: float
    deviation: float


def statistics(values: Sequence[float]) -> Statistics:
    """Return mean, smallest and largest value and standard deviation of at least one value."""
    mean = sum(values) / len(values)
    return Statistics(mean, min(values), max(values), math.sqrt(sum((value - mean) ** 2 for value in values) / len(values)))


def print_rate(topic: str, window: int, filter: str = "", wall: bool = True) -> None:
    """Print the rate of a topic every second, until the user ends it.

    Args:
        topic: Name of the topic.
        window: Number of the newest messages over which the rate is averaged.
        filter: Python expression of the message `m`; only messages for which it is true are counted; "" for all.
        wall: Whether times are read from the monotonic clock of this machine; if not, from the clock of the node.
    """
    times: deque[float] = deque(maxlen=window + 1)

    def report() -> None:
        now = _now(listeners[0], wall)
        if len(times) < 2 or now - times[-1] > REPORT:
            print("no new messages", flush=True)
            return
        gaps = statistics([later - earlier for earlier, later in zip(times, list(times)[1:], strict=False)])
        rate = 1.0 / gaps.mean if gaps.mean > 0.0 else 0.0
        print(f"average rate: {rate:.3f}\n{_statistics_line(gaps, len(times) - 1)}", flush=True)

    def take(data: bytes) -> None:
        if not filter or evaluate_expression(filter, listeners[0].message(data)):
            times.append(_now(listeners[0], wall))

    listeners = list[_Listener]()
    _report(topic, take, report, listeners)


def print_delay(topic: str, window: int) -> None:
    """Print the delay of a topic every second: the time from the stamp of a message to its arrival.

    Args:
        topic: Name of the topic, whose messages must have a header.
        window: Number of the newest messages over which the delay is averaged.
    """
    delays: deque[float] = deque(maxlen=window)
    new = [0]

    def take(data: bytes) -> None:
        message = listeners[0].message(data)
        if not hasattr(message, "header"):
            raise GraphError("msg does not have header")
        delays.append((listeners[0].get_clock().now() - Time.from_msg(message.header.stamp)).nanoseconds * 1e-9)
        new[0] += 1

    def report() -> None:
        if not new[0]:
            print("no new messages", flush=True)
            return
        new[0], late = 0, statistics(delays)
        print(f"average delay: {late.mean:.3f}\n{_statistics_line(late, len(delays))}", flush=True)

    listeners = list[_Listener]()
    _report(topic, take, report, listeners)


def print_bandwidth(topic: str, window: int) -> None:
    """Print every second how many bytes a second a topic carries, averaged over its newest `window` messages."""
    sizes: deque[tuple[float, int]] = deque(maxlen=window)

    def report() -> None:
        if len(sizes) > 1:
            print(bandwidth(sizes, time.monotonic()), flush=True)

    listeners = list[_Listener]()
    _report(topic, lambda data: sizes.append((time.monotonic(), len(data))), report, listeners, f"Subscribed to [{topic}]")


def bandwidth(sizes: Collection[tuple[float, int]], now: float) -> str:
    """Return the two lines that `ros2 topic bw` prints about the bandwidth of a topic.

    Args:
        sizes: Time of arrival (s) and size (bytes) of each message, of which there must be at least one.
        now: Present time by the same clock, s.
    """
    (first, _), *_ = sizes
    total = [size for _, size in sizes]
    per_second = sum(total) / (now - first)
    unit, digits, name = (1.0, 0, "B") if per_second < 1e3 else (1e3, 2, "KB") if per_second < 1e6 else (1e6, 2, "MB")
    rate, mean, least, largest = (f"{value / unit:.{digits}f} {name}" for value in (per_second, *statistics(total)[:3]))
    return f"{rate}/s from {len(total)} messages\n\tMessage size mean: {mean} min: {least} max: {largest}"


def _statistics_line(of: Statistics, window: int) -> str:
    return f"\tmin: {of.least:.3f}s max: {of.largest:.3f}s std dev: {of.deviation:.5f}s window: {window}"


def _now(node: Node, wall: bool) -> float:
    return time.monotonic() if wall else node.get_clock().now().nanoseconds * 1e-9


def _report(topic: str, take: Callable[[bytes], None], report: Callable[[], None], listeners: list[_Listener], greeting: str = "") -> None:
    def make() -> Node:
        listeners.append(_Listener(topic, take, wait=True))
        if greeting:
            print(greeting, flush=True)
        listeners[0].create_timer(REPORT, report)
        return listeners[0]

    _run(make)
