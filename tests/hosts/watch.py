"""Prints what the nodes of a graph tell on /diagnostics, one JSON object a line, and how far the clocks of the nodes are off."""

import json
import sys

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from tt_core.ros.clock_offset import ClockMonitor
from tt_core.ros.diagnostics import Status, read_status
from tt_core.ros.node_main import run
from tt_core.ros.qos import RELIABLE


class Watch(Node):
    """/diagnostics -> standard output."""

    def __init__(self) -> None:
        super().__init__("watch", enable_rosout=False)
        self.create_subscription(DiagnosticArray, "/diagnostics", self.on_diagnostics, RELIABLE)
        self.monitor = ClockMonitor(self, Status(self))

    def on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in read_status(message):
            print(json.dumps(status._asdict()), flush=True)


if __name__ == "__main__":
    rclpy.logging.set_logger_level("watch", rclpy.logging.LoggingSeverity.ERROR)
    sys.exit(run(Watch))
