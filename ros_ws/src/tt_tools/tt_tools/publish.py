"""Publishes a message that the command line gives, once, some times, or at a rate, as `ros2 topic pub`."""

from __future__ import annotations

import time
from typing import NamedTuple

import rclpy
from rclpy.duration import Duration
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from tt_core.errors import TtError

from .message_text import from_values, values_of
from .packages import interface
from .qos import QosWords

DEFAULT = QoSProfile(depth=10)
WAIT, TELL = 0.05, 1.0  # s between two looks for subscribers; between two lines about it
ACKNOWLEDGED = 2.0  # s at the end for reliable subscribers


class PubOptions(NamedTuple):
    """How often is published.

    Attributes:
        rate: 1/s.
        times: How often; without end if 0.
        print_every: Every which message is printed; none if 0.
        wait_for: Subscribers before the first message.
        max_wait: s, to wait for them; None without a bound.
        keep_alive: s, to stay after the last message.
        node_name: Of the publishing node; made if empty.
    """

    rate: float = 1.0
    times: int = 0
    print_every: int = 1
    wait_for: int = 0
    max_wait: float | None = None
    keep_alive: float = 0.1
    node_name: str = ""


def publish(topic: str, kind: str, values: str, qos: QosWords, options: PubOptions) -> None:
    """Publish.

    Args:
        topic: Its name.
        kind: Message type.
        values: The message as a YAML mapping; "auto" stands for a header and "now" for a time of the moment of each message.
        qos: What was asked for on the command line.
        options: How often.

    Raises:
        TtError: There is no such type, the values are none of it, or not all subscribers came.
        KeyboardInterrupt: On an interrupt.
    """
    message_type, given = interface(kind), values_of(values)
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = rclpy.create_node(options.node_name or "_ros2cli_publisher", enable_rosout=False, start_parameter_services=False)
        from_values(message_type, given, node.get_clock().now().to_msg())  # what is wrong is told before anything else
        output = node.create_publisher(message_type, topic, qos.profile(otherwise=DEFAULT))
        _wait(output, options)
        print("publisher: beginning loop", flush=True)
        count, begin = 0, time.monotonic()
        while not options.times or count < options.times:
            message = from_values(message_type, given, node.get_clock().now().to_msg())
            count += 1
            if options.print_every and not count % options.print_every:
                print(f"publishing #{count}: {message!r}\n", flush=True)
            output.publish(message)
            if count != options.times:
                time.sleep(max(0.0, begin + count / options.rate - time.monotonic()))
        output.wait_for_all_acked(Duration(seconds=ACKNOWLEDGED))
        time.sleep(options.keep_alive)
    finally:
        rclpy.try_shutdown()


def _wait(output: rclpy.publisher.Publisher, options: PubOptions) -> None:
    """Wait for subscribers. Raises TtError if not all came in time."""
    begin, reported = time.monotonic(), -TELL
    while output.get_subscription_count() < options.wait_for:
        now = time.monotonic() - begin
        if options.max_wait is not None and now > options.max_wait:
            found = output.get_subscription_count()
            raise TtError(f"Timed out waiting for subscribers: Expected {options.wait_for} subs but found {found}")
        if now > reported + TELL:
            print(f"Waiting for at least {options.wait_for} matching subscription(s)...", flush=True)
            reported = now
        time.sleep(WAIT)
