"""How long a ball takes from its last frame to the arm, hop by hop, through the real nodes. scripts/bench latency

--balls N (default 300) at --rate R a minute (default 94, the most of the machine), all nodes of sim.launch.yaml on this machine. Of each
hop the median and what 99 % of the balls keep, in ms, and as shares of the median of Method 2. That runs in this process on bursts of the
same run: those of the CAPTURED balls that follow the timed ones, so that taking the images disturbs no timed ball. `measure` is timed on
the same bursts. Times of calls are what one core spends, warm. --track lets the wide cameras follow the ball, so that there is a state
between measurement and path. Then the way from a wide camera's frame to the command that a swing begins with is timed, too, for corrections
of a swing for the same ball (camera_to_command) and for first swings (camera_to_first_command), and so is the way of a correction from the
state's message to the planned swing.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import struct
import time
from collections import defaultdict
from functools import partial
from pathlib import Path

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from method2 import method_2
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from report import report
from sensor_msgs.msg import Image
from tt_bringup.demo import free_domain
from tt_core.ros.convert import image_from_message, seconds, stamp_seconds
from tt_core.ros.diagnostics import Event, read_status
from tt_core.ros.qos import RELIABLE, SENSOR
from tt_tools import launch, packages
from tt_vision.capture.assembler import Assembler
from tt_vision.capture.burst import Burst
from tt_vision.measure import measure_burst
from tt_vision.rig import SIDES, high_speed_pair
from tt_vision.warm import warm

HASH = "1fb6175d39f46df8cee9f5f0fca4ed35953e4ebcf8d9461a10c258370ebd7769"  # SHA-256 of method2.py, which must not change
RATE = 94.0  # balls a minute, the most of the machine (dissertation Section 2.5.2)
READY = 120.0  # s until the first command
CAPTURED = 20  # balls whose images are taken
SETTLING = 2  # balls after the first command that are not counted
ON_FIRST = {  # hops by the event that ends them, for the first estimate and what follows from it
    Event.FIRST_ESTIMATE: "first_estimate",
    Event.FOLLOWED: "state",
    Event.PATH: "path",
    Event.STROKES: "strokes",
    Event.SWING: "swing",
    Event.FIRST_COMMAND: "command",
}
ON_REFINED = {  # the same for the refined measurement, where the event comes a second time for the same frame
    Event.MEASURED: "refined",
    Event.FOLLOWED: "refined_state",
    Event.PATH: "refined_path",
    Event.STROKES: "refined_strokes",
    Event.SWING: "corrected_swing",
    Event.FIRST_COMMAND: "corrected_command",
}
HOPS = (*ON_FIRST.values(), *ON_REFINED.values(), "decision")


def check_frozen() -> None:
    """End unless method2.py is as it was."""
    if hashlib.sha256((Path(__file__).parent / "method2.py").read_bytes()).hexdigest() != HASH:
        raise SystemExit("benchmarks/method2.py was changed: shares of its time cannot be compared with earlier ones")


class Watch(Node):
    """Listens to what the nodes tell, by the ball's last frame, and to the images if wanted."""

    def __init__(self) -> None:
        super().__init__("watch", enable_rosout=False)
        self.over, self.hit = 0, 0
        self.latencies = defaultdict[str, dict[str, float]](dict)  # ms by hop, by the stamp of the last frame
        self.images: list[tuple[int, bytes]] = []
        self.create_subscription(DiagnosticArray, "/diagnostics", self.on_diagnostics, RELIABLE)
        self.create_subscription(Odometry, "/ball/state", self.on_state, RELIABLE, raw=True)

    def on_state(self, data: bytes, info: dict[str, int]) -> None:
        sec, nanosec = struct.unpack_from("<iI", data, 4)  # the stamp comes first in a serialized message
        time = seconds(Time(sec=sec, nanosec=nanosec))
        self.latencies[f"{time:.9f}"].setdefault("tracked", 1e3 * (1e-9 * info["source_timestamp"] - time))

    def capture(self) -> None:
        for side, name in enumerate(SIDES):
            self.create_subscription(Image, f"/camera/{name}/image_raw", partial(self.on_image, side), SENSOR, raw=True)

    def on_image(self, side: int, data: bytes) -> None:
        self.images.append((side, bytes(data)))

    def on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in read_status(message):
            if status.event is Event.BALL_OVER:
                self.over += 1
                self.hit += json.loads(status.values["hit"]) is not None
            if "latency_ms" not in status.values:
                continue
            row, latency = self.latencies[status.values["stamp"]], float(status.values["latency_ms"])
            if status.event is Event.NO_SWING:
                if "command" in row:
                    row.setdefault("decision", latency)  # the swing stays as it is
                continue
            if status.event is Event.SWING:
                row["corrects"] = status.values["corrects"] == "True"
            first, refined = ON_FIRST.get(status.event), ON_REFINED.get(status.event)
            if first is not None and first not in row:
                row[first] = latency
            elif refined is not None:
                row.setdefault(refined, latency)


def run(balls: int, track: bool, rate: float = RATE) -> tuple[list[dict[str, float]], list[Burst], float]:
    """Play balls. Return the latencies of each, the bursts that were captured, and the share of the balls that were hit."""
    free_domain()
    given = {"rate": str(rate), "seed": "0", "track": str(track).lower()}
    with launch.System(launch.processes(packages.launch_file("tt_bringup", "sim.launch.yaml"), given), lambda line: None):
        rclpy.init()
        watch, executor = Watch(), SingleThreadedExecutor()
        executor.add_node(watch)

        def until(condition, bound: float) -> None:
            end = time.monotonic() + bound
            while not condition() and time.monotonic() < end:
                executor.spin_once(timeout_sec=0.05)

        until(lambda: any("command" in row for row in watch.latencies.values()), READY)
        start = watch.over + SETTLING
        until(lambda: watch.over >= start, 60.0)
        watch.latencies.clear()
        before, hit = watch.over, watch.hit
        until(lambda: watch.over >= before + balls, READY + 60.0 * balls / rate)
        rows, share = list(watch.latencies.values()), (watch.hit - hit) / max(1, watch.over - before)
        watch.capture()
        before = watch.over
        until(lambda: watch.over >= before + CAPTURED, READY + 60.0 * CAPTURED / rate)
        images = watch.images
        rclpy.try_shutdown()
    return rows, bursts(images), share


def bursts(images: list[tuple[int, bytes]]) -> list[Burst]:
    """Return the bursts of images as estimate_node makes them."""
    assembler, made = Assembler(), list[Burst]()
    for side, data in images:
        message = deserialize_message(data, Image)
        burst = assembler.add(side, stamp_seconds(message.header.stamp), image_from_message(message))
        if burst is not None:
            made.append(burst.seen_by(high_speed_pair()))
    return made


def spent(call, repeats: int = 3) -> float:
    """Return the least time, ms, that one core spends on a call."""
    times = []
    for _ in range(repeats):
        start = time.thread_time()
        call()
        times.append(1e3 * (time.thread_time() - start))
    return min(times)


def by_cameras(rows: list[dict[str, float]]) -> tuple[list[dict[str, float]], list[dict[str, float]]]:
    """The latencies after last frames of the high speed cameras, and those after frames of the wide ones."""
    measured, followed = list[dict[str, float]](), list[dict[str, float]]()
    for row in rows:
        (measured if row.keys() & {"first_estimate", "refined"} else followed).append(row)
    return measured, followed


def method2_ms(captured: list[Burst]) -> float:
    """The median time of Method 2, ms, on bursts."""
    if not captured:
        raise SystemExit("no burst was captured: is another graph running?")
    warm(high_speed_pair())
    vectors = np.array([camera.vector for camera in high_speed_pair()])
    method_2(captured[0].images, captured[0].times, vectors)
    return float(np.median([spent(lambda b=b: method_2(b.images, b.times, vectors)) for b in captured]))


def shares(name: str, times: list[float], yardstick: float) -> dict[str, float]:
    """The count of some times (ms), their median and 99 %, and both as shares of `yardstick` (ms); nothing without times."""
    if not times:
        return {}
    metrics = {f"{name}_count": float(len(times))}
    for p in (50, 99):
        metrics[f"{name}_ms_p{p}"] = float(np.percentile(times, p))
        metrics[f"{name}_share_p{p}"] = float(np.percentile(times, p)) / yardstick
    return metrics


def of_wide_frames(followed: list[dict[str, float]], yardstick: float) -> dict[str, float]:
    """From the stamp of a wide frame to the command that begins a swing, and from state to swing; the latter for corrections only."""
    metrics = {}
    for name, corrects in (("camera_to_command", True), ("camera_to_first_command", False)):
        metrics |= shares(name, [row["command"] for row in followed if "command" in row and row.get("corrects") == corrects], yardstick)
    swings = [row["swing"] - row["tracked"] for row in followed if row.keys() >= {"tracked", "swing"} and row["corrects"]]
    return metrics | shares("state_to_swing", swings, yardstick)


def main() -> None:
    parser = argparse.ArgumentParser(prog="scripts/bench latency")
    parser.add_argument("--json", type=Path, help="write the metrics here")
    parser.add_argument("--balls", "--runs", type=int, default=300, help="balls (default 300)")
    parser.add_argument("--rate", type=float, default=RATE, help="balls a minute (default %(default)s)")
    parser.add_argument("--track", action="store_true", help="the wide cameras follow the ball")
    args = parser.parse_args()
    check_frozen()
    rows, captured, hit = run(args.balls, args.track, args.rate)
    measured, followed = by_cameras(rows)
    yardstick = method2_ms(captured)
    called = [spent(lambda b=b: measure_burst(b)) for b in captured]
    metrics = {"method2_ms": yardstick, "balls": float(len(measured)), "hit_share": hit}
    metrics |= {"measure_ms_p50": float(np.median(called)), "measure_share_p50": float(np.median(called)) / yardstick}
    for hop in HOPS:
        metrics |= shares(f"frame_to_{hop}", [row[hop] for row in measured if hop in row], yardstick)
    metrics |= of_wide_frames(followed, yardstick)
    report("latency", args.balls, metrics, args.json)


if __name__ == "__main__":
    main()
