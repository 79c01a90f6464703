"""A node whose constructor never returns, and holds the global interpreter lock (GIL)."""

import ctypes

from rclpy.node import Node
from tt_core.ros import node_main

node_main.START_TIMEOUT = 2.0  # s instead of 120, to shorten the test


class HangingMake(Node):
    """Blocks in its constructor."""

    def __init__(self) -> None:
        super().__init__("hanging_make")
        ctypes.PyDLL(None).sleep(1000)


def main() -> None:
    node_main.run(HangingMake)
