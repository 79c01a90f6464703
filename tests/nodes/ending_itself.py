"""A node that shuts its context down in a callback while other timers of its process wait in the executor's queue."""

import time

import rclpy
from rclpy.node import Node
from std_msgs.msg import String
from tt_core.ros.node_main import run

BUSY = 0.3  # s, longer than the interval of each timer of the process


class EndingItself(Node):
    """Shuts the context down when it receives its sixth message. In two of three runs other timers wait in the executor's queue then."""

    def __init__(self) -> None:
        super().__init__("ending_itself")
        self._received = 0
        self.create_subscription(String, "end", self._end, 10)
        self._output = self.create_publisher(String, "end", 10)
        self.create_timer(0.1, self._publish)
        self.create_timer(0.05, lambda: time.sleep(0.12))

    def _publish(self) -> None:
        if rclpy.ok():
            for _ in range(3):
                self._output.publish(String())

    def _end(self, _: String) -> None:
        self._received += 1
        if self._received == 6:
            time.sleep(BUSY)
            rclpy.try_shutdown()


def main() -> None:
    run(EndingItself)
