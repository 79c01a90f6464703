"""Half an hour of play: whether hits, memory, descriptors and latency are at its end what they were at its start. scripts/bench endurance

The launches repeat, so that the first and the last balls are the same ones. --minutes of play at 60 balls a minute.
"""

from __future__ import annotations

import argparse
import itertools
import os
import re
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import psutil
from graph import NODES, Ball, Graph, Watch
from report import report
from rich.console import Console
from rich.table import Table
from tt_bringup.demo import free_domain

RATE = 60.0  # balls a minute
ROUND = 300  # balls, after which the launches repeat
SHOTS = 6  # kinds of launches of sim_node, in turn
WARM = 5.0  # minutes, after which memory has to be flat
SAMPLE = 5.0  # s between two looks at memory
HITS = 0.06  # by which the hit shares may differ; one standard deviation of 300 balls at 90 % is 0.017, of a difference 0.025
GROWTH = 0.05  # MB a minute
LATENCY = 1.2  # times the first median, that the last one may be
STREAK = 10  # balls missed one after the other, which a latched arm would miss


def usage(graph: Graph) -> dict[str, tuple[float, int]]:
    """Return memory (MB) and open descriptors of each node with its children.

    Memory is what belongs to the node alone (USS): a share of common pages changes with whatever other program begins or ends.
    """
    found = {}
    for name, pid in tuple(graph.nodes.items()):
        try:
            family = [psutil.Process(pid), *psutil.Process(pid).children(recursive=True)]
            found[name] = sum(p.memory_full_info().uss for p in family) / 1e6, sum(p.num_fds() for p in family)
        except psutil.NoSuchProcess:
            continue
    return found


def reason(watch: Watch, ball: Ball) -> str | None:
    """What the nodes told while a ball flew, without its numbers; None if nothing."""
    words = [f"{w.name}: {w.text}" for w in tuple(watch.warnings) if ball.launched <= w.time <= ball.over + 0.1]
    return re.sub(r"-?[0-9.]+", "#", words[-1]) if words else None


def longest_streak(balls: Sequence[Ball]) -> int:
    """The most balls missed one after the other."""
    longest = current = 0
    for ball in balls:
        current = 0 if ball.hit else current + 1
        longest = max(longest, current)
    return longest


def main() -> None:
    parser = argparse.ArgumentParser(prog="scripts/bench endurance", description=__doc__)
    parser.add_argument("--json", type=Path, help="write the metrics here")
    parser.add_argument("--minutes", type=float, default=30.0, help="of play (default 30)")
    args = parser.parse_args()
    path, count = args.json and args.json.absolute(), int(args.minutes * RATE)
    size = max(SHOTS, min(ROUND, count // 3) // SHOTS * SHOTS)
    free_domain()
    samples = defaultdict[str, list[tuple[float, float, int]]](list)  # minutes, MB, descriptors
    parameters = {"sim": (f"repeat:={size}",), "record": ("exclude:=image_raw",)}
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        with Graph(Path(tempfile.gettempdir()) / "endurance.log", rate=RATE, parameters=parameters) as graph:
            watch, began, missed = graph.watch, time.monotonic(), dict[int, str | None]()
            skipped, seen = watch.balls[-1].number, 0
            while (done := watch.balls[-1].number - skipped) < count and time.monotonic() - began < 90.0 * args.minutes:
                graph.pause(SAMPLE)
                for name, (memory, descriptors) in usage(graph).items():
                    samples[name].append(((time.monotonic() - began) / 60.0, memory, descriptors))
                for ball in tuple(watch.balls)[seen:]:
                    if not ball.hit:
                        missed[ball.number] = reason(watch, ball)
                seen = len(watch.balls)
                if done % 60 < SAMPLE:
                    print(f"{done} balls, {len([n for n in missed if n > skipped])} missed", flush=True)
            balls = [ball for ball in tuple(watch.balls) if ball.number > skipped]
            latencies, ended, bound = tuple(watch.latencies), [name for name, _ in graph.ended if name in NODES], watch.broken()
        os.chdir("/")
    first, last = balls[:size], balls[-size:]
    shares = [float(np.mean([ball.hit for ball in part])) for part in (first, last)]
    medians = [
        float(np.median([ms for time, ms in latencies if part[0].launched <= time <= part[-1].over] or [np.inf])) for part in (first, last)
    ]
    numbers = [ball.number for ball in balls]
    lost = sum(b - a - 1 for a, b in itertools.pairwise(numbers))
    silent = sum(missed.get(ball.number) is None for ball in balls if not ball.hit)
    checks = [
        ("balls", len(balls), count, len(balls) >= count),
        ("hit share, first", shares[0], None, True),
        ("hit share, last", shares[1], shares[0] - HITS, abs(shares[1] - shares[0]) <= HITS),
        ("balls not told of", lost, 0, lost == 0),
        ("balls missed without a reason", silent, 0, silent == 0),
        ("longest streak of misses", longest_streak(balls), STREAK, longest_streak(balls) < STREAK),
        ("latency, first (ms)", medians[0], None, True),
        ("latency, last (ms)", medians[1], LATENCY * medians[0], medians[1] <= LATENCY * medians[0]),
        ("nodes that ended", len(ended), 0, not ended),
        ("bounds of the arm broken", float(bound is not None), 0, bound is None),
    ]
    warm = min(WARM, 0.3 * args.minutes)
    for name, rows in samples.items():
        minutes, memory, descriptors = np.array([row for row in rows if row[0] >= warm]).T
        slope = float(np.polyfit(minutes, memory, 1)[0])
        checks.append((f"{name}: growth of memory (MB/min)", slope, GROWTH, slope <= GROWTH))
        more = float(np.median(descriptors[-5:]) - np.median(descriptors[:5]))
        checks.append((f"{name}: more descriptors", more, 0, more <= 0))
    table = Table("what", "value", "bound", "", title=f"endurance, {args.minutes:g} minutes")
    for name, value, limit, kept in checks:
        table.add_row(name, f"{value:.4g}", "" if limit is None else f"{limit:.4g}", "" if kept else "not kept")
    console = Console()
    console.print(table)
    console.print(dict(Counter(missed.get(ball.number) or "no reason" for ball in balls if not ball.hit)))
    if path:
        report("endurance", len(balls), {name: float(value) for name, value, _, _ in checks}, path)
    raise SystemExit(0 if all(kept for *_, kept in checks) else 1)


if __name__ == "__main__":
    main()
