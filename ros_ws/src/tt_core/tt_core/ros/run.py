"""The main() that every node shares."""

from __future__ import annotations

import sys
from collections.abc import Callable

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.task import Future

from ..errors import TtError


def run(make: Callable[[], Node]) -> None:
    """Spin one node until SIGINT or SIGTERM, then call its `close` if it has one.

    Bad parameters end it with one clear line and exit code 2.
    """
    rclpy.init()
    node = None
    try:
        node = make()
        executor = EventsExecutor()
        executor.add_node(node)
        while rclpy.ok():  # waits without a timeout never dispatch in rclpy 7.1.6
            executor.spin_until_future_complete(Future(), 3600.0)
    except TtError as error:
        print(error, file=sys.stderr)
        raise SystemExit(2) from error
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except RuntimeError:  # from rclpy, when the signal came while the node was made
        if rclpy.ok():
            raise
    finally:
        if node is not None and hasattr(node, "close"):
            node.close()
        rclpy.try_shutdown()
