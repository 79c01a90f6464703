"""The main() that every node shares."""

from __future__ import annotations

import gc
import os
import signal
import sys
import threading
from collections.abc import Callable

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from ..errors import TtError


def _asked_to_end() -> Future:
    """Done at SIGINT or SIGTERM. The context lives on, so that a node can still say its last words."""
    asked, (read, write) = Future(), os.pipe()
    os.set_blocking(write, False)
    signal.set_wakeup_fd(write, warn_on_full_buffer=False)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: None)

    def wait() -> None:  # a thread, because Python's own handlers wait until the executor returns
        os.read(read, 1)
        asked.set_result(None)

    threading.Thread(target=wait, name="signals", daemon=True).start()
    return asked


def run(make: Callable[[], Node]) -> None:
    """Spin one node until SIGINT or SIGTERM, then call its `close` if it has one, and end the context.

    Bad parameters end it with one clear line and exit code 2.
    """
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    node = None
    try:
        node = make()
        gc.collect()
        gc.freeze()  # what is there now lives as long as the node; to look through it again and again takes 50 ms each time
        asked = _asked_to_end()
        executor = EventsExecutor()
        executor.add_node(node)
        while not asked.done():  # waits without a timeout never dispatch in rclpy 7.1.6
            executor.spin_until_future_complete(asked, 3600.0)
    except TtError as error:
        print(error, file=sys.stderr)
        raise SystemExit(2) from error
    except (KeyboardInterrupt, ExternalShutdownException):  # while the node was made; by the node itself
        pass
    finally:
        if node is not None and hasattr(node, "close"):
            node.close()
        rclpy.try_shutdown()
