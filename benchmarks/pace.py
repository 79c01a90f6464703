"""Balls as fast as the machine throws them, through the real nodes: hit rate, latencies, CPU and memory of each. scripts/bench pace

--runs balls, 94 a minute: 282 take three minutes.
"""

from __future__ import annotations

import json
import re
import time
from collections import defaultdict

import numpy as np
import psutil
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from report import arguments, report
from rich.console import Console
from tt_bringup.demo import free_domain
from tt_core.ros.diagnostics import Event, read_status, read_warnings
from tt_core.ros.qos import RELIABLE
from tt_sim.world.outcome import Result
from tt_tools import launch, packages

RATE = 94.0  # balls a minute, the most of the machine (dissertation Section 2.5.2)
READY = 90.0  # s until the first ball is over
STAGES = ("estimate", "predict", "racket", "arm")
SETTLED = 0.2  # of the run, after which memory is compared with the end


class Watch(Node):
    """Listens to what the nodes tell."""

    def __init__(self) -> None:
        super().__init__("watch", enable_rosout=False)
        self.results: list[Result] = []
        self.refusals: list[str] = []
        self.latencies = defaultdict[str, list[float]](list)
        self.create_subscription(DiagnosticArray, "/diagnostics", self.on_diagnostics, RELIABLE)

    def on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in read_status(message):
            values = status.values
            if status.event is Event.BALL_OVER:
                self.results.append(Result(values["result"]) if json.loads(values["hit"]) else Result.MISSED)
            elif status.name in STAGES and "latency_ms" in values and status.event is not Event.SWING:
                self.latencies[status.name].append(float(values["latency_ms"]))
        self.refusals += [f"{s.name}: {re.sub(r'[0-9.]+', '#', s.message)}" for s in read_warnings(message)]


def main() -> None:
    args = arguments("pace", 282)
    free_domain()
    processes = dict[str, psutil.Process]()

    def tell(line: str) -> None:
        started = re.match(r"\[launch\] (\S+) started, process (\d+)", line)
        if started and started[1] not in ("enable", "robot_state_publisher"):  # these may end by themselves
            processes[started[1]] = psutil.Process(int(started[2]))

    given = {"rate": str(RATE), "seed": "0"}
    usage = defaultdict[str, list[tuple[float, float]]](list)  # CPU %, MB
    with launch.System(launch.processes(packages.launch_file("tt_bringup", "sim.launch.yaml"), given), tell):
        rclpy.init()
        watch, executor = Watch(), SingleThreadedExecutor()
        executor.add_node(watch)
        end, sampled = time.monotonic() + READY + args.runs * 60.0 / RATE, time.monotonic()
        skipped: int | None = None  # balls before all nodes were there
        while time.monotonic() < end and (skipped is None or len(watch.results) < skipped + args.runs):
            executor.spin_once(timeout_sec=0.05)
            if skipped is None and watch.latencies["arm"]:
                skipped = len(watch.results) + 1
            if time.monotonic() - sampled > 1.0 and skipped is not None:
                sampled = time.monotonic()
                for name, process in processes.items():
                    family = [process, *process.children(recursive=True)]
                    memory = sum(p.memory_info().rss for p in family) / 1e6
                    spent = sum(sum(p.cpu_times()[:2]) for p in family)
                    usage[name].append((spent, memory))
        rclpy.try_shutdown()
    results = watch.results[skipped or 0 :]
    metrics = {
        "balls": float(len(results)),
        "hit_share": float(np.mean([r is not Result.MISSED for r in results])),
        "landed_share": float(np.mean([r is Result.RETURNED for r in results])),
    }
    for stage in STAGES:
        for p in (50, 95, 99):
            metrics[f"{stage}_latency_ms_p{p}"] = float(np.percentile(watch.latencies[stage], p))
    for name, rows in usage.items():
        spent, memory = np.array(rows).T
        metrics[f"{name}_cpu_percent"] = 100.0 * (spent[-1] - spent[0]) / max(1, len(rows) - 1)
        metrics[f"{name}_memory_mb"] = memory[-1]
        metrics[f"{name}_growth_mb"] = memory[-1] - memory[int(SETTLED * len(rows))]
    report("pace", args.runs, metrics, args.json)
    Console().print({word: watch.refusals.count(word) for word in set(watch.refusals)}, {r.value: results.count(r) for r in set(results)})


if __name__ == "__main__":
    main()
