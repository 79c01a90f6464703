"""Two 900 Hz cameras, 97 MB/s, recorded while the graph plays: messages lost, CPU and memory. scripts/bench record

--runs seconds. The recording goes to a new folder on the disk of the project, which needs 0.1 GB a second, and is removed.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil
import rclpy
from camera_stream import RATE, TOPICS
from pace import READY, Watch
from rclpy.executors import SingleThreadedExecutor
from report import arguments, report
from rich.console import Console
from tt_bringup.demo import free_domain
from tt_core.ros.bags import Bag
from tt_core.shared_memory import SEGMENT_VARIABLE
from tt_sim.world.outcome import Result
from tt_tools import launch, packages

BALLS = "60.0"  # a minute
SEGMENT = 64 * 2**20  # bytes of shared memory of the cameras' process: images of 0.7 s, for which the recorder may be held up
ENDING = 30.0  # s for the recorder to write the rest


def main() -> None:
    args = arguments("record", 60)
    free_domain()
    recorder: list[psutil.Process] = []

    def tell(line: str) -> None:
        if started := re.match(r"\[launch\] record started, process (\d+)", line):
            recorder.append(psutil.Process(int(started[1])))

    with tempfile.TemporaryDirectory(dir=Path.cwd()) as folder:
        bag = Path(folder) / "bag"
        given = {"rate": BALLS, "seed": "0", "record": "true", "output": str(bag)}
        with launch.System(launch.processes(packages.launch_file("tt_bringup", "sim.launch.yaml"), given), tell):
            rclpy.init()
            watch, executor = Watch(), SingleThreadedExecutor()
            executor.add_node(watch)
            end = time.monotonic() + READY
            while not watch.latencies["arm"] and time.monotonic() < end:
                executor.spin_once(timeout_sec=0.05)
            skipped = len(watch.results)
            program = [sys.executable, str(Path(__file__).with_name("camera_stream.py")), str(args.runs)]
            environment = {**os.environ, SEGMENT_VARIABLE: str(SEGMENT)}
            stream = subprocess.Popen(program, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment)
            spent, begin, memory = sum(recorder[-1].cpu_times()[:2]), time.monotonic(), 0.0
            psutil.cpu_percent()  # from here on
            while time.monotonic() - begin < args.runs + 2.0:
                executor.spin_once(timeout_sec=0.05)
                memory = max(memory, recorder[-1].memory_info().rss / 1e6)
            busy = psutil.cpu_percent()
            sent, publishing = stream.communicate("\n", timeout=ENDING)[0].split()
            spent, took = sum(recorder[-1].cpu_times()[:2]) - spent, time.monotonic() - begin
            rclpy.try_shutdown()
        with Bag(bag) as recording:
            counts = {topic.name: topic.count for topic in recording.topics}
            size = recording.size
        shutil.rmtree(bag)
    results = watch.results[skipped:]
    metrics = {
        "sent_images": 2.0 * int(sent),
        "rate_share": int(sent) / (RATE * args.runs),
        "lost_images": 2.0 * int(sent) - sum(counts[topic] for topic in TOPICS),
        "recorded_mb_per_s": size / took / 1e6,
        "recorder_cpu_percent": 100.0 * spent / took,
        "recorder_memory_mb": memory,
        "publisher_cpu_percent": 100.0 * float(publishing) / args.runs,
        "machine_cpu_percent": busy,
        "balls": float(len(results)),
        "hit_share": sum(result is not Result.MISSED for result in results) / max(1, len(results)),
    }
    report("record", args.runs, metrics, args.json)
    Console().print({word: watch.refusals.count(word) for word in set(watch.refusals)})


if __name__ == "__main__":
    main()
