"""Subscriptions with a bound on the size of their messages, which is checked before a message is converted."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from ..errors import BadMessage, MessageFailure, TtError
from .qos import compatible

PUBLISHER_CHECK_INTERVAL = 0.25  # s between two checks which publishers a topic has

# bytes, size above which a serialized message is refused
LARGEST_STATE = 4096  # state of the ball, which has 730
LARGEST_PATH = 2**19  # path of the ball: 2000 points have 270 kB
LARGEST_STROKES = 2**15  # 128 strokes
LARGEST_GOAL = 4096  # goal of a return: one point has 200
LARGEST_JOINTS = 2**16  # joint state of 500 joints
LARGEST_INFO = 4096  # CameraInfo; one with 14 coefficients has 500
LARGEST_PHYSICS = 2**15  # learnt coefficients, which have 3,000


class Input:
    """Subscription to one topic that refuses messages above a given size.

    The subscription adapts to its publishers. It asks for the quality of service `qos`. If one publisher offers less (best effort instead
    of reliable, volatile instead of transient local), it asks for no more than that, because DDS would not connect the two otherwise.

    Attributes:
        topic: Full name of the topic.
        publishers: Number of publishers of the topic at the last check.
    """

    def __init__(
        self,
        node: Node,
        kind: type,
        topic: str,
        callback: Callable[[Any], None],
        qos: QoSProfile | tuple[QoSProfile, QoSProfile],
        *,
        largest: int,
        refused: Callable[[TtError], None],
        interval: float = 0.0,
        read: Callable[[bytes], Any] | None = None,
    ) -> None:
        """Subscribe.

        Args:
            node: The node that subscribes.
            kind: Message type.
            topic: Name, relative or absolute.
            callback: Called with each message that is accepted, or with what `read` makes of it.
            qos: Quality of service that is asked for if the publishers offer it. Of a pair, the second is used while all publishers are
                reliable.
            largest: Bytes of a serialized message, above which it is refused.
            refused: Takes the error of each message that is not accepted, because of its size or because it cannot be read.
            interval: s. A message that comes sooner than this after the last one is dropped without being read.
            read: Reads a serialized message; `callback` gets its result. It raises TtError for a message with a wrong content, and
                RuntimeError for bytes that are no message of this type. None: `callback` gets a message of type `kind`.
        """
        self._node, self._kind, self._callback = node, kind, callback
        self._read = read or partial(deserialize_message, message_type=kind)
        self._wanted, self._reliably = qos if isinstance(qos, tuple) else (qos, qos)
        self._largest, self._refused, self._interval, self._due = largest, refused, interval, 0.0
        self.topic, self.publishers = node.resolve_topic_name(topic), 0
        self._asked = self._wanted
        self._subscription = self._subscribe()
        node.create_timer(PUBLISHER_CHECK_INTERVAL, self.check_publishers, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def check_publishers(self) -> None:
        """Check which publishers the topic has, and subscribe again if they require another quality of service."""
        offered = [info.qos_profile for info in self._node.get_publishers_info_by_topic(self.topic)]
        self.publishers = len(offered)
        is_reliable = all(qos.reliability is ReliabilityPolicy.RELIABLE for qos in offered)
        asked = compatible(self._reliably if is_reliable else self._wanted, offered)
        if offered and (asked.reliability, asked.durability) != (self._asked.reliability, self._asked.durability):
            self._asked, old = asked, self._subscription
            self._subscription = self._subscribe()  # first, for a publisher that waits for this node must always see it
            self._node.destroy_subscription(old)

    def _subscribe(self) -> Any:
        events = SubscriptionEventCallbacks(use_default_callbacks=False)  # an event of a destroyed subscription ends the executor
        return self._node.create_subscription(self._kind, self.topic, self._on_data, self._asked, event_callbacks=events, raw=True)

    def _on_data(self, data: bytes) -> None:
        if self._interval:
            now = time.monotonic()
            if now < self._due:
                return
            self._due = now + self._interval
        try:
            if len(data) > self._largest:
                raise BadMessage(MessageFailure.TOO_LARGE, topic=self.topic, size=len(data), most=self._largest)
            content = self._read(data)
        except TtError as error:
            self._refused(error)
        except RuntimeError as error:  # rclpy's RMWError: the bytes are no message of this type
            self._refused(BadMessage(MessageFailure.UNREADABLE, topic=self.topic, error=error))
        else:
            self._callback(content)
