"""Publishes a recording as it was, byte for byte."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import closing
from pathlib import Path

import rclpy
from builtin_interfaces.msg import Time
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rosbags.interfaces import ConnectionExtRosbag2, Qos, QosDurability, QosReliability
from rosbags.rosbag2 import Reader
from rosgraph_msgs.msg import Clock
from tt_core.ros.listeners import is_heard

from .packages import NotFound, interface
from .play import Step, pace, with_clock
from .record import BagError, open_bag

DEPTH = 1000  # messages that a slow subscriber may be behind
POLL = 0.05  # s between two looks for subscribers
FIRST, QUIET = 30.0, 3.0  # s to wait for the first subscriber, and after each for one more: nodes that start together come together
MATCH = 0.2  # s until a subscriber that we know knows us too
ACKNOWLEDGED = Duration(seconds=2)  # to wait at the end for reliable subscribers


def offering_qos(recorded: Collection[Qos]) -> QoSProfile:
    """What serves all who could listen to the recorded publishers."""
    reliable = not recorded or any(qos.reliability is QosReliability.RELIABLE for qos in recorded)
    durable = any(qos.durability is QosDurability.TRANSIENT_LOCAL for qos in recorded)
    return QoSProfile(
        depth=DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if durable else DurabilityPolicy.VOLATILE,
    )


class PlayNode(Node):
    """A bag -> its topics, and /clock with the recorded time `clock` times a second."""

    def __init__(self, reader: Reader, topics: Collection[str], remap: Mapping[str, str], clock: float | None, context: Context) -> None:
        super().__init__("player", context=context, enable_rosout=False, start_parameter_services=False)
        self._reader, self._connections = reader, []
        self._outputs: dict[str, Publisher] = {}
        for connection in reader.connections:
            topic = connection.topic
            if (topics and topic not in topics) or (clock and topic == "/clock"):
                continue
            try:
                kind = interface(connection.msgtype)
            except NotFound as error:
                self.get_logger().warning(f"{topic} is left out: {error}")
                continue
            self._connections.append(connection)
            offered = connection.ext.offered_qos_profiles if isinstance(connection.ext, ConnectionExtRosbag2) else ()
            self._outputs[topic] = self.create_publisher(kind, remap.get(topic, topic), offering_qos(offered))
        if missing := set(topics) - self._outputs.keys():
            self.get_logger().warning(f"not in the bag: {', '.join(sorted(missing))}")
        self._period = 1.0 / clock if clock else None
        self._clock_output = self.create_publisher(Clock, "/clock", 10) if clock else None

    def _tick(self, time: int) -> None:
        if self._clock_output is not None:
            self._clock_output.publish(Clock(clock=Time(sec=time // 10**9, nanosec=time % 10**9)))

    def wait_for_subscribers(self) -> int:
        """Until each topic has one or no more come, the clock standing at the start; the number of topics that have one."""
        matched, end = 0, time.monotonic() + FIRST
        while matched < len(self._outputs) and time.monotonic() < end:
            time.sleep(POLL)
            self._tick(self._reader.start_time)
            now = sum(is_heard(self, output) for output in self._outputs.values())
            if now > matched:
                matched, end = now, time.monotonic() + QUIET
        time.sleep(MATCH)
        return matched

    def play(self, rate: float) -> int:
        """Publishes all and tells how many messages that were. rate: recorded seconds in a second."""
        count, start, stop = 0, self._reader.start_time, self._reader.end_time
        steps = self._messages()
        if self._period is not None:
            steps = with_clock(steps, start, stop, round(self._period * rate * 1e9))
        for step in pace(steps, start, rate, time.monotonic, time.sleep):
            if step.topic is None:
                self._tick(step.time)
            else:
                self._outputs[step.topic].publish(step.data)
                count += 1
        for output in self._outputs.values():
            output.wait_for_all_acked(ACKNOWLEDGED)
        return count

    def _messages(self) -> Iterator[Step]:
        for connection, time_, data in self._reader.messages(self._connections):
            yield Step(time_, connection.topic, bytes(data))


def play(
    bag: Path,
    *,
    topics: Collection[str] = (),
    rate: float = 1.0,
    clock: float | None = None,
    delay: float = 0.0,
    remap: Mapping[str, str] | None = None,
) -> int:
    """Plays a bag to its end and tells how many messages it published. Raises BagError.

    topics: all if empty. rate: recorded seconds in a second. clock: Hz, of /clock by the recorded time. delay: s, to wait first.
    remap: new names by old ones.
    """
    context = Context()
    with closing(open_bag(bag)) as reader:
        if not reader.message_count:
            raise BagError(f"{bag} holds no messages")
        rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
        try:
            node = PlayNode(reader, topics, remap or {}, clock, context)
            time.sleep(delay)
            print(f"playing {bag}: {node.wait_for_subscribers()} of its topics have a listener", flush=True)
            return node.play(rate)
        finally:
            context.try_shutdown()
