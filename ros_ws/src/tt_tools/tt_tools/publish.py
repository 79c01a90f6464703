"""Publish a message that is given on the command line, once, several times or at a rate, as `ros2 topic pub` does."""

from __future__ import annotations

import time
from typing import NamedTuple

import rclpy
from rclpy.duration import Duration
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from tt_core.errors import TtError

from .message_text import message_from_values, values_of
from .packages import interface
from .qos import QosWords

DEFAULT_QOS = QoSProfile(depth=10)
SUBSCRIBER_CHECK_INTERVAL = 0.05  # s between two checks for subscribers
SUBSCRIBER_REPORT_INTERVAL = 1.0  # s between two lines printed about them
ACKNOWLEDGEMENT_TIMEOUT = 2.0  # s, longest wait at the end for reliable subscribers to acknowledge the messages


class PubOptions(NamedTuple):
    """Options of `ros2 topic pub`.

    Attributes:
        rate: Messages per second.
        times: Number of messages to publish; 0 for no limit.
        print_every: N to print every N-th message; 0 to print none.
        wait_for: Number of subscribers that must be there before the first message.
        max_wait: Longest wait for these subscribers, s; None for no limit.
        keep_alive: Time for which the publisher stays after the last message, s.
        node_name: Name of the node that publishes; "" for "_ros2cli_publisher".
    """

    rate: float = 1.0
    times: int = 0
    print_every: int = 1
    wait_for: int = 0
    max_wait: float | None = None
    keep_alive: float = 0.1
    node_name: str = ""


def publish(topic: str, kind: str, values: str, qos: QosWords, options: PubOptions) -> None:
    """Publish a message on a topic, as often as the options tell, and then end.

    Args:
        topic: Name of the topic.
        kind: Message type, e.g. std_msgs/msg/String.
        values: The message as a YAML mapping of its fields. "auto" in place of a header, and "now" in place of a time, stand for the time
            at which each message is published.
        qos: Quality-of-service options of the command line.
        options: How often the message is published, and what is awaited and printed.

    Raises:
        TtError: There is no such type, the values do not fit it, or not all subscribers came within `options.max_wait`.
        KeyboardInterrupt: The user has interrupted the command.
    """
    message_type, given = interface(kind), values_of(values)
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = rclpy.create_node(options.node_name or "_ros2cli_publisher", enable_rosout=False, start_parameter_services=False)
        message_from_values(
            message_type, given, node.get_clock().now().to_msg()
        )  # raises an error in the values before anything is published
        output = node.create_publisher(message_type, topic, qos.profile(otherwise=DEFAULT_QOS))
        _wait(output, options)
        print("publisher: beginning loop", flush=True)
        count, begin = 0, time.monotonic()
        while not options.times or count < options.times:
            message = message_from_values(message_type, given, node.get_clock().now().to_msg())
            count += 1
            if options.print_every and not count % options.print_every:
                print(f"publishing #{count}: {message!r}\n", flush=True)
            output.publish(message)
            if count != options.times:
                time.sleep(max(0.0, begin + count / options.rate - time.monotonic()))
        output.wait_for_all_acked(Duration(seconds=ACKNOWLEDGEMENT_TIMEOUT))
        time.sleep(options.keep_alive)
    finally:
        rclpy.try_shutdown()


def _wait(output: rclpy.publisher.Publisher, options: PubOptions) -> None:
    """Wait until as many subscribers are there as the options ask for. Raises TtError after `options.max_wait`."""
    begin, reported = time.monotonic(), -SUBSCRIBER_REPORT_INTERVAL
    while output.get_subscription_count() < options.wait_for:
        now = time.monotonic() - begin
        if options.max_wait is not None and now > options.max_wait:
            found = output.get_subscription_count()
            raise TtError(f"Timed out waiting for subscribers: Expected {options.wait_for} subs but found {found}")
        if now > reported + SUBSCRIBER_REPORT_INTERVAL:
            print(f"Waiting for at least {options.wait_for} matching subscription(s)...", flush=True)
            reported = now
        time.sleep(SUBSCRIBER_CHECK_INTERVAL)
