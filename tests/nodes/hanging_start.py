"""A node that refuses its parameters, and blocks forever while it is destroyed with the global interpreter lock (GIL) held."""

import ctypes

from rclpy.node import Node
from tt_core.errors import OutOfRange
from tt_core.ros import node_main

node_main.OWN_EXIT_TIMEOUT = 2.0  # s instead of 15, to shorten the test


class HangingStart(Node):
    """Is destroyed with what it holds, `itself`."""

    def __init__(self) -> None:
        super().__init__("hanging_start")
        self.itself = self
        raise OutOfRange("some_parameter", 3.0, 0.0, 2.0)

    def __del__(self) -> None:
        ctypes.PyDLL(None).sleep(1000)


def main() -> None:
    node_main.run(HangingStart)
