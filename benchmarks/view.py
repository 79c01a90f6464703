"""What the live view costs the control path: latencies with and without it, in turn in the same graph. scripts/bench view

With it, a client reads everything that the page sends and draws nothing. --runs balls in all, 60 a minute.
"""

from __future__ import annotations

import asyncio
import json
import re
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import psutil
import rclpy
import viser
import websockets
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from report import arguments, report
from tt_bringup.demo import free_domain, free_port
from tt_core.ros.diagnostics import Event, read_status
from tt_core.ros.qos import RELIABLE
from tt_tools import launch, packages

RATE = 60.0  # balls a minute
BLOCK = 15  # balls with the view, then as many without it
READY = 90.0  # s until the first swing
AWAY = 2  # balls at the start of each block that do not count: the view starts or ends


class Watch(Node):
    """Listens to what the nodes tell."""

    def __init__(self) -> None:
        super().__init__("watch", enable_rosout=False)
        self.balls, self.is_viewed, self.is_counted = 0, False, False
        self.latencies = defaultdict[bool, list[float]](list)  # ms from the last frame to the first command, by whether there is a view
        self.hits = defaultdict[bool, list[bool]](list)
        self.create_subscription(DiagnosticArray, "/diagnostics", self.on_diagnostics, RELIABLE)

    def on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in read_status(message):
            if status.event is Event.FIRST_COMMAND and self.is_counted:
                self.latencies[self.is_viewed].append(float(status.values["latency_ms"]))
            elif status.event is Event.BALL_OVER:
                self.balls += 1
                if self.is_counted:
                    self.hits[self.is_viewed].append(json.loads(status.values["hit"]) is not None)


async def read_all(port: int) -> None:
    """Connect to the page as soon as it is served; count its messages and their bytes, and print both once a second."""
    page = f"127.0.0.1:{port}"
    protocols = [websockets.Subprotocol(f"viser-v{viser.__version__}")]
    while True:
        try:
            socket = await websockets.connect(f"ws://{page}", origin=f"http://{page}", subprotocols=protocols, max_size=None)
            break
        except OSError:
            await asyncio.sleep(0.2)
    async with socket:
        count, size, due = 0, 0, time.monotonic() + 1.0
        async for message in socket:
            count, size = count + 1, size + len(message)
            if time.monotonic() > due:
                print(count, size, flush=True)
                count, size, due = 0, 0, time.monotonic() + 1.0


@contextmanager
def viewed(seconds: dict[str, list[float]]) -> Iterator[None]:
    """Show the graph to a client; append messages and MB a second that it received, and the CPU of the view in percent."""
    port = free_port()
    view = psutil.Popen([str(packages.executable("tt_bringup", "view_node")), "--ros-args", "-p", f"port:={port}"], start_new_session=True)
    client = subprocess.Popen([sys.executable, __file__, "--client", str(port)], stdout=subprocess.PIPE, text=True)
    client.stdout.readline()  # of its first second
    started, spent = time.monotonic(), sum(view.cpu_times()[:2])
    try:
        yield
        seconds["cpu"].append(100.0 * (sum(view.cpu_times()[:2]) - spent) / (time.monotonic() - started))
    finally:
        client.terminate()
        view.terminate()
        for line in client.communicate()[0].splitlines():
            count, size = map(float, line.split())
            seconds["messages"].append(count)
            seconds["megabytes"].append(size / 1e6)
        view.wait()


def main() -> None:
    args = arguments("view", 120)
    free_domain()
    seconds = defaultdict[str, list[float]](list)
    processes = launch.processes(packages.launch_file("tt_bringup", "sim.launch.yaml"), {"rate": str(RATE), "seed": "0"})
    with launch.System(processes, lambda line: None if re.match(r"\[launch\]", line) else print(line)):
        rclpy.init()
        watch, executor = Watch(), SingleThreadedExecutor()
        executor.add_node(watch)

        def wait(balls: int, bound: float) -> None:
            end, goal = time.monotonic() + bound, watch.balls + balls
            while watch.balls < goal and time.monotonic() < end:
                executor.spin_once(timeout_sec=0.05)

        def block() -> None:
            watch.is_counted = False
            wait(AWAY, 60.0)
            watch.is_counted = True
            wait(BLOCK, 60.0)
            watch.is_counted = False

        wait(3, READY)
        while min(len(watch.hits[False]), len(watch.hits[True])) < args.runs // 2:
            watch.is_viewed = False
            block()
            with viewed(seconds):
                watch.is_viewed = True
                block()
        rclpy.try_shutdown()
    metrics = {}
    for is_viewed, name in ((False, "without"), (True, "with")):
        metrics[f"{name}_balls"] = float(len(watch.hits[is_viewed]))
        metrics[f"{name}_hit_share"] = float(np.mean(watch.hits[is_viewed]))
        for p in (50, 95, 99):
            metrics[f"{name}_latency_ms_p{p}"] = float(np.percentile(watch.latencies[is_viewed], p))
    metrics["page_messages_per_s"] = float(np.median(seconds["messages"]))
    metrics["page_megabytes_per_s"] = float(np.median(seconds["megabytes"]))
    metrics["view_cpu_percent"] = float(np.mean(seconds["cpu"]))
    report("view", args.runs, metrics, args.json)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--client"]:
        asyncio.run(read_all(int(sys.argv[2])))
    else:
        main()
