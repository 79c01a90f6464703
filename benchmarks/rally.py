"""Whole rallies without ROS, images rendered: what is hit, what lands, how near to what was asked. scripts/bench rally --runs 1000"""

from __future__ import annotations

import os
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor

import numpy as np
from report import arguments, report
from rich.console import Console
from rich.progress import track
from tt_core.constants import RPM
from tt_core.physics import Physics
from tt_sim.episode import Scenario, landing_error, play, spin_error
from tt_sim.launcher import KINDS

SCALES = (3, 4, 5)  # of the catapult, as in the dissertation's experiments


def one(seed: int) -> tuple[str | None, list[float]]:
    """Why it failed, and of a returned ball: landing m, time s, spin rad/s off what was asked; of every ball: measured spin off, rpm."""
    episode = play(Scenario(KINDS[seed % len(KINDS)], SCALES[seed // len(KINDS) % len(SCALES)]), seed)
    measured = spin_error(episode, Physics.liu())
    row = [np.nan, np.nan, np.nan, np.nan if measured is None else measured / RPM]
    hit, landing, goal = episode.outcome.hit, episode.outcome.landing, episode.goal
    if episode.reason is None and hit and landing and goal:
        spin_off = float(np.hypot(*(hit.after.spin[1:] - [goal.spin_y, goal.spin_z])))
        row[:3] = [landing_error(episode) or 0.0, abs(landing.before.time - hit.before.time - goal.flight_time), spin_off]
    reason = None if episode.reason is None else episode.reason.split(":")[0] if episode.outcome.hit is None else episode.reason
    return reason, row


def main() -> None:
    args = arguments("rally", 240)
    start = time.perf_counter()
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        done = list(track(pool.map(one, range(args.runs), chunksize=4), total=args.runs, description="balls"))
    took = time.perf_counter() - start
    rows = np.array([row for _, row in done])
    reasons = Counter(reason for reason, _ in done if reason is not None)
    returned = args.runs - sum(reasons.values())
    missed = sum(count for reason, count in reasons.items() if reason not in ("net", "own half", "off the table", "second hit", "flying"))
    metrics = {"hit_share": 1.0 - missed / args.runs, "landed_share": returned / args.runs}
    for name, column in zip(("landing_error_m", "time_error_s", "spin_error_rad_s", "measured_spin_error_rpm"), rows.T, strict=True):
        metrics |= {f"{name}_{label}": float(np.nanpercentile(column, p)) for label, p in (("median", 50), ("p95", 95), ("worst", 100))}
    metrics["balls_per_second"] = args.runs / took
    report("rally", args.runs, metrics, args.json)
    Console().print("not returned:", dict(reasons.most_common()) or "none")


if __name__ == "__main__":
    main()
