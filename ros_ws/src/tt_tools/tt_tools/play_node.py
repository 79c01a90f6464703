"""Publishes a recording byte for byte, after the subscribers that it waits for have come."""

from __future__ import annotations

import os
import select
import signal
import sys
import time
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import rclpy
from builtin_interfaces.msg import Time
from rclpy.duration import Duration
from rclpy.expand_topic_name import expand_topic_name
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rosbags.interfaces import Qos, QosDurability, QosReliability
from rosgraph_msgs.msg import Clock
from tt_core.errors import TtError
from tt_core.params import check, param
from tt_core.ros.bags import TYPES, Bag, BagError
from tt_core.ros.discovery import RECORDERS, listeners
from tt_core.ros.params import declare

from .packages import NotFound, interface
from .play import Step, pace, with_clock

DEPTH = 1000  # messages that a slow subscriber may be behind
POLL = 0.05  # s between two looks for subscribers
DISCOVERY = 1.0  # s, within which running nodes are usually discovered
ACKNOWLEDGED, SLICE = 2.0, 0.05  # s at the end for reliable subscribers, in slices between which an interrupt is seen


@dataclass(frozen=True)
class PlayParams:
    """What is played and how."""

    bag: str = param("", "", "path of a bag of any kind")
    rate: float = param(1.0, "", "recorded seconds in a second", low=1e-3, high=1e3)
    clock: float = param(0.0, "Hz", "rate of /clock with the recorded time; 0 for none", low=0.0, high=1e4)
    topics: tuple[str, ...] = param((), "", "topics to play; all if empty")
    delay: float = param(0.0, "s", "time to wait before anything else", low=0.0, high=1e6)
    wait_for: tuple[str, ...] = param((), "", "topics, played or not, each of which must have a subscriber before playback begins")
    recorded: bool = param(False, "", "whether playback also waits until a recorder subscribes to all topics that are published")
    patience: float = param(120.0, "s", "longest wait for the subscribers that playback waits for", low=0.0, high=1e6)
    linger: float = param(0.0, "s", "time to stay after the last message, so that subscribers can finish", low=0.0, high=1e6)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


class Interrupts:
    """Handles SIGINT and SIGTERM: they end the player at its next sleep, never inside the middleware."""

    def __init__(self) -> None:
        self._read, write = os.pipe()
        os.set_blocking(write, False)
        signal.set_wakeup_fd(write, warn_on_full_buffer=False)
        self._handle(lambda *_: None)

    @staticmethod
    def _handle(handler: object) -> None:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, handler)  # type: ignore[arg-type]

    def sleep(self, seconds: float) -> None:
        """Sleep for `seconds`. Raises KeyboardInterrupt if a signal came, now or before."""
        if select.select([self._read], [], [], max(0.0, seconds))[0]:
            raise KeyboardInterrupt

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """Let a signal interrupt whatever is done in this context; it must not be the middleware."""
        self._handle(signal.default_int_handler)
        try:
            self.sleep(0.0)
            yield
        finally:
            self._handle(lambda *_: None)


def offering_qos(recorded: Collection[Qos]) -> QoSProfile:
    """Return the profile that serves every subscriber which the recorded publishers could serve."""
    reliable = not recorded or any(qos.reliability is QosReliability.RELIABLE for qos in recorded)
    durable = any(qos.durability is QosDurability.TRANSIENT_LOCAL for qos in recorded)
    return QoSProfile(
        depth=DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if durable else DurabilityPolicy.VOLATILE,
    )


class PlayNode(Node):
    """Publishes the topics of a bag, and /clock with the recorded time."""

    def __init__(self, params: PlayParams | None = None) -> None:
        """Make the node.

        Args:
            params: What is played and how; by the node's parameters if None.
        """
        super().__init__("player", enable_rosout=False, start_parameter_services=False)
        self.params = params or declare(self, PlayParams)
        self._outputs: dict[tuple[str, str], Publisher] = {}
        self._ticks = self.create_publisher(Clock, "/clock", 10) if self.params.clock else None

    def offer(self, bag: Bag, remap: Mapping[str, str]) -> None:
        """Make the publishers. Topics that cannot be played are left out, by name.

        Args:
            bag: What is played.
            remap: New names by old ones.
        """
        wanted = [expand_topic_name(name, self.get_name(), self.get_namespace()) for name in self.params.topics]
        for topic in bag.topics:
            if (wanted and topic.name not in wanted) or (self._ticks and topic.name == "/clock"):
                continue
            try:
                kind = interface(topic.kind)
            except NotFound as error:
                self.get_logger().warning(f"{topic.name} is left out: {topic.refusal or error}")
                continue
            if topic.refusal:
                self.get_logger().warning(f"{topic.name} is left out: {topic.refusal}")
                continue
            output = self.create_publisher(kind, remap.get(topic.name, topic.name), offering_qos(topic.offered))
            self._outputs[topic.name, topic.kind] = output
        if missing := set(wanted) - {topic.name for topic in bag.topics}:
            self.get_logger().warning(f"not in the bag: {', '.join(sorted(missing))}")

    def wait(self, start: int, interrupts: Interrupts) -> None:
        """Wait for subscribers; meanwhile the clock stands at the start.

        Without `wait_for` and `recorded` this takes no longer than DISCOVERY.

        Args:
            start: ns, time of the recording at which the clock stands.
            interrupts: To sleep with.

        Raises:
            TtError: If not all came within `patience`.
        """
        patient = bool(self.params.wait_for or self.params.recorded)
        end = time.monotonic() + (self.params.patience if patient else DISCOVERY)
        since: float | None = None  # s, when the last one came
        while since is None or time.monotonic() < since + (DISCOVERY if patient else 0.0):
            self._tick(start)
            interrupts.sleep(POLL)
            missing = self._missing() if patient else self._unmatched()
            since = None if missing else since or time.monotonic()
            if missing and time.monotonic() > end:
                if patient:
                    raise TtError(f"nobody listens to {', '.join(missing)} within {self.params.patience:g} s")
                return

    def _unmatched(self) -> list[str]:
        return [output.topic_name for output in self._outputs.values() if not output.get_subscription_count()]

    def _missing(self) -> list[str]:
        """Return the topics whose subscribers playback still waits for."""
        ours = set(self._unmatched())
        wanted = [self.resolve_topic_name(name) for name in self.params.wait_for]
        missing = [name for name in wanted if name in ours or not listeners(self, name) - RECORDERS]
        if self.params.recorded:
            for name, kinds in self.get_topic_names_and_types():
                if self.count_publishers(name) and _can_be_recorded(kinds[0]) and not listeners(self, name) & RECORDERS:
                    missing.append(f"{name} (to record it)")
        return missing

    def play(self, bag: Bag, interrupts: Interrupts) -> int:
        """Publish all messages.

        Args:
            bag: What is played.
            interrupts: To sleep with.

        Returns:
            How many messages were published.
        """
        rate, count = self.params.rate, 0
        steps: Iterator[Step] = (Step(m.time, (m.topic, m.kind), m.data) for m in bag.messages({name for name, _ in self._outputs}))
        if self._ticks is not None:
            steps = with_clock(steps, bag.start, bag.end, round(rate / self.params.clock * 1e9))
        for step in pace(steps, bag.start, rate, time.monotonic, interrupts.sleep):
            if step.topic is None:
                self._tick(step.time)
            elif output := self._outputs.get(step.topic):
                output.publish(step.data)
                count += 1
        end = time.monotonic() + ACKNOWLEDGED
        for output in self._outputs.values():
            while not output.wait_for_all_acked(Duration(seconds=SLICE)) and time.monotonic() < end:
                interrupts.sleep(0.0)
        interrupts.sleep(self.params.linger)
        return count

    def _tick(self, time: int) -> None:
        if self._ticks is not None:
            self._ticks.publish(Clock(clock=Time(sec=time // 10**9, nanosec=time % 10**9)))


def _can_be_recorded(kind: str) -> bool:
    try:
        interface(kind)
    except NotFound:
        return False
    return kind in TYPES.types


def play(params: PlayParams | None = None, remap: Mapping[str, str] | None = None) -> int:
    """Play a bag to its end.

    Args:
        params: What is played and how; by the ROS parameters of the command line if None.
        remap: New names by old ones.

    Returns:
        How many messages were published.

    Raises:
        TtError: If the bag cannot be read, or not all subscribers came that playback waits for.
        KeyboardInterrupt: If SIGINT or SIGTERM came.
    """
    interrupts = Interrupts()
    rclpy.init(args=[] if params else None, signal_handler_options=SignalHandlerOptions.NO)
    node = None
    try:
        node = PlayNode(params)
        path = Path(node.params.bag)
        with interrupts.at_once():
            bag = Bag(path)
        with bag:
            if not bag.count:
                raise BagError(f"{path} holds no messages")
            node.offer(bag, remap or {})
            interrupts.sleep(node.params.delay)
            node.wait(bag.start, interrupts)
            print(f"playing {path}", flush=True)
            return node.play(bag, interrupts)
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()


def main() -> int:
    """Play by the ROS parameters of the command line."""
    try:
        print(f"played {play()} messages", flush=True)
    except TtError as error:
        print(f"play: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        pass
    return 0


if __name__ == "__main__":
    sys.exit(main())
