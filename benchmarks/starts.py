"""Starts of all nodes, four at a time, interrupted at random moments of their first 10 s while both cores are busy. scripts/bench starts

--runs starts, of which half are interrupted within 10 s after the node was made, while it spins. Ends with exit code 1 unless every one
ended in order: in time, with exit code 0 or by the signal itself, without a traceback, and without leaving a process.
"""

from __future__ import annotations

import itertools
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import psutil
from report import arguments, report
from rich.console import Console
from rich.table import Table
from tt_bringup.demo import free_domain
from tt_tools import packages

BAG = Path(__file__).parents[1] / "bags" / "reference_back_5"
NODES: dict[str, tuple[str, tuple[str, ...]]] = {
    "sim_node": ("tt_sim", ()),
    "camera_node": ("tt_vision", ("--ros-args", "-p", "kind:=bag", "-p", f"path:={BAG}")),
    "estimate_node": ("tt_vision", ()),
    "track_node": ("tt_vision", ()),
    "predict_node": ("tt_predict", ()),
    "racket_node": ("tt_racket", ()),
    "arm_node": ("tt_arm", ()),
    "enable": ("tt_arm", ("--ros-args", "-r", "arm/enable:=arm/enable_nothing")),
    "record_node": ("tt_tools", ("--ros-args", "-p", "output:=bag")),
}
AT_ONCE, LOADS = 4, 2
MOMENTS = 10.0  # s from the start in which the signal comes
BOUND, LONGEST = 3.0, 30.0  # s from the signal to the end: what is promised, and when it is killed
READY = 60.0  # s, at most, for a node to be made
MARK = "TT_STARTS"  # environment variable by which a start's processes are known


@dataclass(frozen=True)
class Start:
    """One start.

    Attributes:
        moment: When the signal is sent, s after the start, or if `made` after the node was made.
        code: Exit code.
        took: Time from the signal to the end, s.
        left: How many processes outlived it.
        printed: What it wrote to stderr.
    """

    node: str
    sent: signal.Signals
    moment: float
    made: bool
    code: int
    took: float
    left: int
    printed: str

    @property
    def traceback(self) -> bool:
        return "Traceback" in self.printed

    @property
    def in_order(self) -> bool:
        return self.code in (0, -self.sent) and self.took < BOUND and not self.traceback and not self.left


def start(node: str, sent: signal.Signals, moment: float, made: bool) -> Start:
    """Start a node, wait until it is made if `made`, send the signal `moment` s later and see how it ends."""
    package, words = NODES[node]
    mark = str(uuid.uuid4())
    with tempfile.TemporaryDirectory() as folder, (Path(folder) / "stderr").open("w+") as stderr:
        command, environment = [str(packages.executable(package, node)), *words], {**os.environ, MARK: mark}
        process = subprocess.Popen(command, cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=stderr)
        end = time.monotonic() + READY
        while made and not is_made(process) and time.monotonic() < end:
            time.sleep(0.1)
        time.sleep(moment)
        began = time.monotonic()
        process.send_signal(sent)
        try:
            code = process.wait(LONGEST)
        except subprocess.TimeoutExpired:
            process.kill()
            code = process.wait()
        took = time.monotonic() - began
        left = leave(mark, began + max(BOUND, took))
        stderr.seek(0)
        return Start(node, sent, moment, made, code, took, left, stderr.read())


def is_made(process: subprocess.Popen) -> bool:
    """Whether the node has taken over SIGTERM, or has ended."""
    if process.poll() is not None:
        return True
    caught = re.search(r"SigCgt:\s*(\w+)", Path(f"/proc/{process.pid}/status").read_text())
    return caught is None or bool(int(caught[1], 16) >> (signal.SIGTERM - 1) & 1)


def leave(mark: str, until: float) -> int:
    """How many processes with the mark there still are at the time `until` (s, monotonic); they are killed."""
    while (left := [p for p in psutil.process_iter() if marked(p, mark)]) and time.monotonic() < until:
        time.sleep(0.1)
    for process in left:
        process.kill()
    return len(left)


def marked(process: psutil.Process, mark: str) -> bool:
    try:
        return process.status() != psutil.STATUS_ZOMBIE and process.environ().get(MARK) == mark
    except psutil.Error:
        return False


def main() -> None:
    args = arguments("starts", 100)
    free_domain()
    os.environ["ROS_LOG_DIR"] = tempfile.gettempdir()
    rng = random.Random(0)
    drawn = []
    for node in itertools.islice(itertools.cycle(NODES), args.runs):
        made = rng.random() < 0.5 and node != "enable"  # which never takes over the signals
        drawn.append((node, rng.choice((signal.SIGINT, signal.SIGTERM)), rng.uniform(0.0, MOMENTS), made))
    with ExitStack() as stack:
        for _ in range(LOADS):
            load = stack.enter_context(subprocess.Popen([sys.executable, "-c", "while True: pass"]))
            stack.callback(load.kill)
        with ThreadPoolExecutor(AT_ONCE) as pool:
            starts = list(pool.map(lambda one: start(*one), drawn))
    table = Table("node", "starts", "exit codes", "longest, s", "tracebacks", "left", title=f"starts, {args.runs} runs")
    for node in NODES:
        own = [one for one in starts if one.node == node]
        codes = ", ".join(f"{count} x {code}" for code, count in sorted(Counter(one.code for one in own).items()))
        longest = max((one.took for one in own), default=0.0)
        tracebacks, left = sum(one.traceback for one in own), sum(one.left for one in own)
        table.add_row(node, str(len(own)), codes, f"{longest:.2f}", str(tracebacks), str(left))
    Console().print(table)
    wrong = [one for one in starts if not one.in_order]
    for one in wrong:
        when = f"{one.moment:.3f} s after it was {'made' if one.made else 'started'}"
        print(f"{one.node}, {one.sent.name} {when}: exit code {one.code} in {one.took:.2f} s, {one.left} left\n{one.printed}")
    metrics = {
        "starts": float(len(starts)),
        "closed": float(sum(one.code == 0 for one in starts)),
        "ended_by_signal": float(sum(one.code == -one.sent for one in starts)),
        "longest_s": max(one.took for one in starts),
        "tracebacks": float(sum(one.traceback for one in starts)),
        "processes_left": float(sum(one.left for one in starts)),
        "not_in_order": float(len(wrong)),
    }
    report("starts", args.runs, metrics, args.json)
    raise SystemExit(1 if wrong else 0)


if __name__ == "__main__":
    main()
