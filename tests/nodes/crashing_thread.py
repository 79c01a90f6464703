"""A node with two threads: one crashes, the other finds the context ended while it works."""

import threading
import time

from rclpy.node import Node
from tt_core.ros.node_main import run


class CrashingThread(Node):
    """Raises in a thread 0.2 s after it was made."""

    def __init__(self) -> None:
        super().__init__("crashing_thread")
        threading.Thread(target=self.crash, daemon=True).start()
        threading.Thread(target=self.ask, daemon=True).start()

    def crash(self) -> None:
        time.sleep(0.2)
        raise RuntimeError("a crash")

    def ask(self) -> None:
        while True:
            self.get_publishers_info_by_topic("/nothing")

    def close(self) -> None:
        print("closed", flush=True)


def main() -> None:
    run(CrashingThread)
