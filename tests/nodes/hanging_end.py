"""A node that blocks forever while it is destroyed, and holds the global interpreter lock (GIL) meanwhile."""

import ctypes

from rclpy.node import Node
from tt_core.ros.node_main import run


class HangingEnd(Node):
    """Hangs as Fast DDS sometimes does (its issue 6502)."""

    def __init__(self) -> None:
        super().__init__("hanging_end")

    def destroy_node(self) -> None:
        ctypes.PyDLL(None).sleep(1000)


def main() -> None:
    run(HangingEnd)
