"""A node that blocks forever while it is made, and holds the global interpreter lock (GIL) meanwhile."""

import ctypes

from rclpy.node import Node
from tt_core.ros import node_main

node_main.START_TIMEOUT = 2.0  # s instead of 120, to shorten the test


class HangingMake(Node):
    """Is never made."""

    def __init__(self) -> None:
        super().__init__("hanging_make")
        ctypes.PyDLL(None).sleep(1000)


def main() -> None:
    node_main.run(HangingMake)
