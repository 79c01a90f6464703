"""Whole rallies without ROS: what is hit, what lands, how near to what was asked, how fast it is played. scripts/bench rally

--runs balls each of the worlds `liu` and `real` with images rendered, and ten times as many of `liu` by the measurement's error model, in
one process, whose memory is watched.
"""

from __future__ import annotations

import functools
import time

import numpy as np
import psutil
from report import arguments, report
from rich.console import Console
from rich.progress import track
from tt_eval.episode import play
from tt_eval.evaluate import percentiles, why
from tt_eval.miss import Miss
from tt_eval.process_pool import process_pool
from tt_eval.scenario import Scenario, load
from tt_eval.sweep_metrics import sweep_metrics

SCENARIOS = ("liu", "real")
WARM = 20  # balls of a process before it is timed; they load kernels and draw the marks of the balls


def one(scenario: Scenario, seed: int) -> dict[str, float | str]:
    return sweep_metrics(play(scenario, seed))


def rates(rows: list[dict[str, float | str]]) -> dict[str, float]:
    column = {key: np.array([row[key] for row in rows]) for key in rows[0] if not isinstance(rows[0][key], str)}
    metrics = {"hit_share": float(column["hit"].mean()), "landed_share": float(column["landed"].mean())}
    judged = [f"judged_{name}" for name in ("landing_error", "time_error", "return_spin_error")]
    for name in ("landing_error", "time_error", "return_spin_error", "measured_spin_error_rpm", *judged):
        metrics[f"{name}_median"], metrics[f"{name}_p95"] = percentiles(column[name])
    for name in ("landing_x", "landing_y", "flight_time", "spin_y", "spin_z"):
        off = column[f"judged_{name}"] - column[name]
        metrics[f"judge_{name}_mean"], metrics[f"judge_{name}_uncertainty"] = float(np.nanmean(off)), float(np.nanstd(off))
    metrics["judged_otherwise_share"] = float(np.mean([row["miss"] != row["judged_miss"] for row in rows]))
    return metrics


def alone(scenario: Scenario, balls: int) -> tuple[float, float]:
    """Balls a second in this one process, and by how many MB it grows over the last nine tenths of them."""
    for seed in range(WARM):
        play(scenario, seed)
    process, start, before = psutil.Process(), time.perf_counter(), 0.0
    for seed in track(range(balls), description=f"{scenario.name}, one process"):
        sweep_metrics(play(scenario, seed))
        if seed == balls // 10:
            before = process.memory_info().rss
    return balls / (time.perf_counter() - start), (process.memory_info().rss - before) / 1e6


def main() -> None:
    args = arguments("rally", 1000)
    metrics, console = dict[str, float](), Console()
    for name in SCENARIOS:
        with process_pool() as pool:
            played = pool.map(functools.partial(one, load(name)), range(args.runs), chunksize=8)
            rows = list(track(played, total=args.runs, description=name))
        metrics |= {f"{name}_{key}": value for key, value in rates(rows).items()}
        console.print(f"{name}, missed:", why([Miss(row["miss"]) for row in rows if row["miss"]]) or "none")
    metrics["images_balls_per_second_and_core"], _ = alone(load("liu"), max(20, args.runs // 10))
    metrics["fast_balls_per_second_and_core"], metrics["fast_growth_mb"] = alone(load("liu", images=False), 10 * args.runs)
    report("rally", args.runs, metrics, args.json)


if __name__ == "__main__":
    main()
