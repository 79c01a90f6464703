"""Record the messages of topics to a bag, as serialized bytes that are not decoded."""

from __future__ import annotations

import itertools
import os
import re
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden
from rclpy.type_support import check_for_type_support
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from std_msgs.msg import String
from tt_core.errors import TtError
from tt_core.failures import code_name
from tt_core.params import check, param
from tt_core.revision import revision
from tt_core.robots import read_arm
from tt_core.ros.bags import BagError
from tt_core.ros.diagnostics import Status
from tt_core.ros.node_main import run
from tt_core.ros.params import declare
from tt_core.ros.qos import compatible

from .bagfile import RESERVE, SplitRule
from .node_parameters import ParameterCollector
from .packages import NotFound, interface
from .qos import KEEP_ALL
from .record import QUEUE, Recording, State
from .reindex import compress
from .sequence_gaps import SequenceGaps

TOPIC_CHECK_INTERVAL = 0.1  # s between two checks for new topics, which is the default of rosbag2, and between two checks of the disk
TAKE = 0.005  # s between two looks for messages
LOSS_REPORT_INTERVAL = 1.0  # s between two status messages while messages are lost


class _Topic(NamedTuple):
    """A topic that is recorded.

    It has a bare subscription, whose messages are taken by a timer, and no event for lost messages: with the executor, rmw_fastrtps 8.4 can
    wait forever for itself when messages are lost. Its `take_event` locks the event and then the reader, and the thread that receives
    locks both in the other order.

    Attributes:
        handle: The subscription.
        message: Type of its messages.
        gaps: Counts its lost messages.
    """

    handle: Any
    message: type
    gaps: SequenceGaps


def offered_qos(profile: QoSProfile) -> Qos:
    """Return the quality of service of a publisher in the form in which `rosbags` writes it to a bag."""

    def split(duration: Duration) -> QosTime:
        return QosTime(*divmod(duration.nanoseconds, 10**9))

    return Qos(
        QosHistory(profile.history.value),
        profile.depth,
        QosReliability(profile.reliability.value),
        QosDurability(profile.durability.value),
        split(profile.deadline),
        split(profile.lifespan),
        QosLiveliness(profile.liveliness.value),
        split(profile.liveliness_lease_duration),
        profile.avoid_ros_namespace_conventions,
    )


def free_name(output: str) -> str:
    """Return `output` if it does not exist, else the first of output_2, output_3, ... that does not."""
    names = itertools.chain([output], (f"{output.rstrip('/')}_{number}" for number in itertools.count(2)))
    return next(name for name in names if not Path(name).exists())


def read_layout(file: str) -> str:
    """Return the text of a layout file. Raises TtError if it cannot be read."""
    try:
        return Path(file).read_text()
    except (OSError, UnicodeDecodeError) as error:
        raise TtError(f"layout {file} cannot be read: {error}") from error


@dataclass(frozen=True)
class RecordParams:
    """Parameters of the recorder: which topics it records, to which bag, and how it uses the disk."""

    output: str = param("auto", "", "new directory of the bag; auto: bags/ and the time")
    numbered: bool = param(False, "", "add a number to `output` if it exists, as a recorder needs that is started again")
    topics: tuple[str, ...] = param((), "", "topics to record; all if neither topics nor `regex` are given")
    regex: str = param("", "", "regular expression; topics in which it is found are recorded, too")
    exclude: str = param("", "", "regular expression; topics in which it is found are not recorded")
    exclude_topics: tuple[str, ...] = param((), "", "topics that are not recorded")
    hidden: bool = param(False, "", "whether topics are recorded whose names have a part that begins with _")
    compression: str = param("none", "", "lz4: while it records; zstd: when the recording has ended", choices=("none", "lz4", "zstd"))
    split_bytes: int = param(0, "bytes", "size at which the next file of the bag begins; 0: one file", low=0, high=2**50)
    split_seconds: float = param(0.0, "s", "time after which the next file of the bag begins; 0: one file", low=0.0, high=1e9)
    attach: bool = param(True, "", "whether the bag gets the parameters of all nodes, the description of the arm and the revision")
    layout: str = param("", "", "file with the layout of a viewer, which the bag gets as an attachment of the same name; empty: none")
    queue_bytes: int = param(QUEUE, "bytes", "most that waits for the disk; what is beyond is dropped and counted", low=2**20, high=2**40)
    reserve_bytes: int = param(RESERVE, "bytes", "what stays free on the disk", low=0, high=2**40)

    def __post_init__(self) -> None:
        """Refuse values outside their range, and texts that are no valid regular expressions."""
        check(self)
        for name in ("regex", "exclude"):
            try:
                re.compile(getattr(self, name))
            except re.error as error:
                raise TtError(f"{name} = {getattr(self, name)!r} is no regular expression: {error}") from error

    def wants(self, topic: str) -> bool:
        """Return whether the topic with the resolved name `topic` is recorded. `topics` and `exclude_topics` must be resolved, too."""
        if topic in self.exclude_topics or (self.exclude and re.search(self.exclude, topic)):
            return False
        if topic in self.topics or (self.regex and re.search(self.regex, topic)):
            return True
        return not (self.topics or self.regex) and (self.hidden or not topic_or_service_is_hidden(topic))


class RecordNode(Node):
    """Node that subscribes to topics, records them to a new bag, and publishes on /diagnostics how many messages are lost.

    RecordParams tells which topics are recorded, and how the disk is used.

    Attributes:
        params: The parameters, with resolved names of topics.
        failed: After `close`: whether messages were dropped, or the bag could not be closed.
    """

    def __init__(self) -> None:
        """Declare the parameters, make the bag, and begin to look for topics. Raises BagError if the bag cannot be made."""
        super().__init__("record", enable_rosout=False, start_parameter_services=False)
        params = declare(self, RecordParams)
        output = time.strftime("bags/%Y-%m-%d_%H-%M-%S") if params.output == "auto" else params.output
        self.kept_parameters: dict[str, Any] | None = {} if params.numbered else None  # a new process needs a new directory
        if params.numbered:
            output = free_name(output)
        topics, excluded = (tuple(map(self.resolve_topic_name, names)) for names in (params.topics, params.exclude_topics))
        self.params = replace(params, topics=topics, exclude_topics=excluded)
        self._seen: set[str] = set()
        self._published, self._when = State(None, 0, 0, {}, {}), 0.0  # the last published state, and when it was published, s
        self.failed = False
        self._status = Status(self)
        self._topics: dict[str, _Topic] = {}
        layout = read_layout(params.layout) if params.layout else None
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(TOPIC_CHECK_INTERVAL, self._look, clock=steady)
        self.create_timer(TAKE, self._take, clock=steady)
        # the bag is made last, so that an error before it leaves no bag behind
        self._recording = Recording(
            Path(output),
            queue_bytes=params.queue_bytes,
            reserve_bytes=params.reserve_bytes,
            compression="lz4" if params.compression == "lz4" else "none",
            split=SplitRule(params.split_bytes, params.split_seconds),
        )
        self._collector = ParameterCollector(self, self._on_parameters) if params.attach else None
        self._described = not params.attach  # whether the description of the arm is in the bag already, or is not wanted
        if params.attach:
            self._recording.attach("revision.txt", "text/plain", revision() + "\n")
        if layout is not None:
            self._recording.attach(Path(params.layout).name, "application/json", layout)
        print(f"recording to {output}", flush=True)

    def _look(self) -> None:
        self._report(self._recording.state())
        for name, kinds in self.get_topic_names_and_types():
            if name in self._seen or not self.params.wants(name):
                continue
            if offered := [info.qos_profile for info in self.get_publishers_info_by_topic(name)]:
                self._seen.add(name)
                self._subscribe(name, kinds[0], offered)
        if self._collector is not None:
            self._collector.check()

    def _on_parameters(self, node: str, values: dict[str, Any], text: str) -> None:
        """Attach the parameters of a node to the bag, and the URDF of the arm that its parameter `robot` names."""
        self._recording.attach(f"parameters{node}.yaml", "application/yaml", text)
        if "robot" in values and not self._described:
            with suppress(OSError, UnicodeDecodeError, TtError):
                self._describe(read_arm(values["robot"])[1].read_text())

    def _describe(self, urdf: str) -> None:
        """Attach the URDF of the arm to the bag."""
        self._described = True
        self._recording.attach("robot_arm_urdf.urdf", "application/xml", urdf)

    def _report(self, state: State) -> None:
        """Publish the state at once when trouble begins or ends, and every second while messages are lost."""
        changed = code_name(state.trouble) != code_name(self._published.trouble)
        losing = (state.dropped, state.missed) != (self._published.dropped, self._published.missed)
        if not changed and not ((state.trouble or losing) and time.monotonic() > self._when + LOSS_REPORT_INTERVAL):
            return
        if changed and state.trouble:
            self.get_logger().error(f"{state.trouble}; what cannot be recorded is dropped and counted")
        elif changed:
            self.get_logger().warning(f"recording again; dropped so far: {sum(state.dropped.values())} messages")
        counts: dict[str, Any] = {"free_bytes": state.free, "queued_bytes": state.queued}
        losses = {f"{name} {topic}": n for name in ("dropped", "missed") for topic, n in getattr(state, name).items()}
        text, failed = str(state.trouble or "recording"), state.trouble is not None
        self._status.publish(text, warn=losing, error=failed, reason=state.trouble, code=code_name(state.trouble), **counts, **losses)
        self._published, self._when = state, time.monotonic()

    def _subscribe(self, name: str, kind: str, offered: list[QoSProfile]) -> None:
        try:
            message = interface(kind)
            self._recording.add_topic(name, kind, [offered_qos(profile) for profile in offered])
        except (NotFound, BagError) as error:
            self.get_logger().warning(f"{name} is left out: {error}")
            return
        check_for_type_support(message)
        with self.handle:
            handle = rclpy_implementation.Subscription(self.handle, message, name, compatible(KEEP_ALL, offered).get_c_qos_profile())
        publishers = lambda: frozenset(bytes(info.endpoint_gid) for info in self.get_publishers_info_by_topic(name))  # noqa: E731
        self._topics[name] = _Topic(handle, message, SequenceGaps(publishers))

    def _take(self) -> None:
        """Record the messages that have arrived since the last call, in the order of their arrival."""
        batch = []
        for name, topic in self._topics.items():
            with topic.handle:
                for _ in range(KEEP_ALL.depth):
                    if not (taken := topic.handle.take_message(topic.message, True)):
                        break
                    data, info = taken
                    batch.append((info["received_timestamp"] or time.time_ns(), name, data))
                    if missing := topic.gaps.add(info["publication_sequence_number"]):
                        self._recording.count_missed(name, missing)
        for received, name, data in sorted(batch, key=itemgetter(0)):
            self._recording.add(name, received, data)
            if not self._described and name.endswith("/robot_description"):
                with suppress(RuntimeError):  # the message has another type
                    self._describe(deserialize_message(data, String).data)

    def close(self) -> None:
        """Record the messages that still wait, close the bag, and print its summary.

        The subscriptions are destroyed later, because Fast DDS sometimes never returns from that (its issue 6502), and the bag must be
        complete by then.
        """
        self._take()
        try:
            summary = self._recording.close()
        except BagError as error:
            self.failed = True
            print(error, file=sys.stderr, flush=True)
            return
        self.failed = bool(summary.dropped)
        if self.params.compression == "zstd":
            try:
                compress(summary.directory, "zstd")
            except BagError as error:
                print(error, file=sys.stderr, flush=True)
        print(f"recorded {summary}", file=sys.stderr if self.failed else sys.stdout, flush=True)

    def destroy_node(self) -> None:
        """Destroy the subscriptions, which the base class does not know, and the node."""
        for topic in self._topics.values():
            topic.handle.destroy_when_not_in_use()
        super().destroy_node()


def main() -> None:
    """Run the node. The exit code is 1 if messages were dropped because of the disk, or the bag could not be closed."""
    nodes: list[RecordNode] = []

    def make() -> RecordNode:
        nodes.append(RecordNode())
        return nodes[0]

    run(make)
    if nodes and nodes[0].failed:
        os._exit(1)  # the writer thread may hang in a write for ever, and a normal exit would wait for its file


if __name__ == "__main__":
    main()
