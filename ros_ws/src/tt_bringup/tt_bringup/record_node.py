"""Records topics as they are on the wire, without looking into the messages."""

from __future__ import annotations

import re
import time
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from tt_core.errors import TtError
from tt_core.ros.params import parameter
from tt_core.ros.run import run

from .packages import NotFound, interface
from .record import BagError, Recording

POLL = 0.1  # s between two looks for new topics, the default of rosbag2
DEPTH = 1000  # messages that may wait: half a second of two cameras at 900 Hz


def offered_qos(profile: QoSProfile) -> Qos:
    """The profile of a publisher in the words of the bag."""

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


def matching_qos(offered: list[QoSProfile]) -> QoSProfile:
    """What every one of the publishers can serve."""
    reliable = all(profile.reliability is ReliabilityPolicy.RELIABLE for profile in offered)
    durable = all(profile.durability is DurabilityPolicy.TRANSIENT_LOCAL for profile in offered)
    return QoSProfile(
        depth=DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if durable else DurabilityPolicy.VOLATILE,
    )


class RecordNode(Node):
    """Topics -> a new rosbag2 directory, `output`, or bags/ and the time.

    All topics, or those in `topics`, less those in which the regex `exclude` is found.
    """

    def __init__(self) -> None:
        super().__init__("record", enable_rosout=False, start_parameter_services=False)
        output = parameter(self, "output", "auto")
        if output == "auto":
            output = time.strftime("bags/%Y-%m-%d_%H-%M-%S")
        self._wanted = {self.resolve_topic_name(str(name)) for name in parameter(self, "topics", [])}
        exclude = parameter(self, "exclude", "")
        try:
            self._exclude = re.compile(exclude) if exclude else None
        except re.error as error:
            raise TtError(f"exclude = {exclude!r} is no regular expression: {error}") from error
        self._seen: set[str] = set()
        self._lost: dict[str, int] = {}
        self.create_timer(POLL, self._look)
        self._recording = Recording(Path(output))  # last: what fails before it leaves no bag
        print(f"recording to {output}", flush=True)

    def _look(self) -> None:
        for name, kinds in self.get_topic_names_and_types():
            if name in self._seen or (self._wanted and name not in self._wanted) or (self._exclude and self._exclude.search(name)):
                continue
            if offered := [info.qos_profile for info in self.get_publishers_info_by_topic(name)]:
                self._seen.add(name)
                self._subscribe(name, kinds[0], offered)

    def _subscribe(self, name: str, kind: str, offered: list[QoSProfile]) -> None:
        try:
            message = interface(kind)
            self._recording.add_topic(name, kind, [offered_qos(profile) for profile in offered])
        except (NotFound, BagError) as error:
            self.get_logger().warning(f"{name} is left out: {error}")
            return
        events = SubscriptionEventCallbacks(message_lost=partial(self._on_lost, name))
        self.create_subscription(message, name, partial(self._on_message, name), matching_qos(offered), raw=True, event_callbacks=events)

    def _on_message(self, topic: str, data: bytes) -> None:
        self._recording.add(topic, time.time_ns(), data)

    def _on_lost(self, topic: str, event: Any) -> None:
        self._lost[topic] = event.total_count

    def close(self) -> None:
        print(f"recorded {self._recording.close()}", flush=True)
        for topic, count in self._lost.items():
            print(f"lost {count} messages on {topic}", flush=True)


def main() -> None:
    run(RecordNode)


if __name__ == "__main__":
    main()
