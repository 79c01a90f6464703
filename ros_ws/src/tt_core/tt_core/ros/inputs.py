"""Subscriptions with a bound on the size of their messages, which is checked before a message is converted."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from nav_msgs.msg import Odometry
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import CameraInfo, JointState
from std_msgs.msg import String
from trajectory_msgs.msg import MultiDOFJointTrajectory

from ..errors import BadMessage, MessageFailure, TtError
from .convert import path_from_bytes, strokes_from_bytes
from .qos import compatible

PUBLISHER_CHECK_INTERVAL = 0.25  # s between two checks which publishers a topic has


@dataclass(frozen=True, slots=True)
class MessageForm:
    """Form of the messages of a topic.

    Attributes:
        kind: Message type.
        largest: Bytes of a serialized message, above which it is refused.
        read: Reads a serialized message. It raises TtError for a message with a wrong content, and RuntimeError for bytes that are no
            message of this type. None: rclpy reads it as a message of type `kind`.
    """

    kind: type
    largest: int
    read: Callable[[bytes], Any] | None = None


# The numbers are the largest sizes that are read, in bytes. The comments tell, for comparison, how large messages are.
STATE_FORM = MessageForm(Odometry, 4096)  # a message with the state of a ball has 730 bytes
PATH_FORM = MessageForm(MultiDOFJointTrajectory, 2**19, path_from_bytes)  # a path of 2000 points has 256 kB
STROKES_FORM = MessageForm(MultiDOFJointTrajectory, 2**15, strokes_from_bytes)  # a list of 64 strokes has 8 kB
GOAL_FORM = MessageForm(MultiDOFJointTrajectory, 4096)  # a goal is a trajectory of one point, which has 176 bytes
JOINTS_FORM = MessageForm(JointState, 2**16)  # a joint state of 500 joints has 20 kB
INFO_FORM = MessageForm(CameraInfo, 4096)  # a calibration with 14 coefficients has 500 bytes
PHYSICS_FORM = MessageForm(String, 2**15)  # the text with all learnt coefficients has 3 kB


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
        form: MessageForm,
        topic: str,
        callback: Callable[[Any], None],
        qos: QoSProfile | tuple[QoSProfile, QoSProfile],
        *,
        refused: Callable[[TtError], None],
        interval: float = 0.0,
    ) -> None:
        """Subscribe.

        Args:
            node: The node that subscribes.
            form: Form of the messages.
            topic: Name, relative or absolute.
            callback: Called with each message that is accepted, as `form.read` returns it.
            qos: Quality of service that is asked for if the publishers offer it. Of a pair, the second is used while all publishers are
                reliable.
            refused: Takes the error of each message that is not accepted, because of its size or because it cannot be read.
            interval: s. A message that comes sooner than this after the last one is dropped without being read.
        """
        self._node, self._form, self._callback = node, form, callback
        self._read = form.read or partial(deserialize_message, message_type=form.kind)
        self._wanted, self._reliably = qos if isinstance(qos, tuple) else (qos, qos)
        self._refused, self._interval, self._due = refused, interval, 0.0
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
        return self._node.create_subscription(self._form.kind, self.topic, self._on_data, self._asked, event_callbacks=events, raw=True)

    def _on_data(self, data: bytes) -> None:
        if self._interval:
            now = time.monotonic()
            if now < self._due:
                return
            self._due = now + self._interval
        try:
            if len(data) > self._form.largest:
                raise BadMessage(MessageFailure.TOO_LARGE, topic=self.topic, size=len(data), most=self._form.largest)
            content = self._read(data)
        except TtError as error:
            self._refused(error)
        except RuntimeError as error:  # rclpy's RMWError: the bytes are no message of this type
            self._refused(BadMessage(MessageFailure.UNREADABLE, topic=self.topic, error=error))
        else:
            self._callback(content)
