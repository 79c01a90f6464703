"""The robot on two machines beside one: hit share, latency, and what a cut of the network costs. scripts/bench hosts

Both machines are network namespaces of this computer, so they share its cores and its clock; it takes root. --runs balls, 30 a minute, are
played on one machine and on two, all topics recorded; then the cable is out for 0.2, 1 and 5 s while the arm swings.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from report import arguments, report
from tt_bringup.demo import free_domain

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "hosts"))
from two_hosts import Session, is_hit, longest_publish, one_host, two_hosts, two_machines

RATE = 30.0  # balls a minute
START = 120.0  # s until the first ball is hit
CUTS = (0.2, 1.0, 5.0)  # s
REPEATS = 3  # of each cut
NEXT = 30.0  # s


def play(session: Session, balls: int, name: str) -> dict[str, float]:
    """Play `balls` after the first one that is hit."""
    session.wait(lambda: any(map(is_hit, session.balls())), START, "a hit")
    begun = session.balls()[-1].time
    session.wait(lambda: len(session.balls(begun)) >= balls, NEXT + 60.0 / RATE * balls, f"{balls} balls")
    latencies = session.latencies(begun)
    shares = {f"{name}_hit_share": float(np.mean([is_hit(ball) for ball in session.balls(begun)[:balls]]))}
    return shares | {f"{name}_latency_ms_p{p}": float(np.percentile(latencies, p)) for p in (50, 95)}


def main() -> None:
    args = arguments("hosts", 30)
    free_domain()
    domain, given = int(os.environ["ROS_DOMAIN_ID"]), f"rate:={RATE}"
    metrics: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as name, two_machines() as (one, other):
        folder = Path(name)
        with one_host(one, folder, domain, folder / "one", given) as session:
            metrics |= play(session, args.runs, "one")
        with two_hosts(one, other, folder, domain, folder / "two", given) as session:
            metrics |= play(session, args.runs, "two")
            metrics |= {f"added_latency_ms_p{p}": metrics[f"two_latency_ms_p{p}"] - metrics[f"one_latency_ms_p{p}"] for p in (50, 95)}
            offsets = [float(t.values["least_ms"]) for t in session.statuses if t.name == "watch"]
            metrics["clock_offset_beyond_uncertainty_ms"] = max(offsets)
            for cut in CUTS:
                waited, missed = [], []
                for _ in range(REPEATS):
                    begun = len(session.latencies())
                    session.wait(lambda n=begun: len(session.latencies()) > n, NEXT, "a swing")  # type: ignore[misc]
                    other.unplug()
                    time.sleep(cut)
                    other.plug()
                    again = time.time()
                    session.wait(lambda since=again: any(map(is_hit, session.balls(since))), NEXT, "a hit after the cut")  # type: ignore[misc]
                    waited.append(time.time() - again)
                    missed.append(sum(not is_hit(ball) for ball in session.balls(again)))
                metrics |= {f"cut_{cut:g}s_until_hit_s": max(waited), f"cut_{cut:g}s_missed_after": float(max(missed))}

        def cable_out() -> None:
            other.unplug()
            time.sleep(1.0)
            other.plug()

        def slow() -> None:
            with one.slow():
                time.sleep(3.0)

        metrics["longest_publish_cut_ms"] = 1e3 * longest_publish(one, other, folder, domain, cable_out)
        metrics["longest_publish_slow_ms"] = 1e3 * longest_publish(one, other, folder, domain, slow)
    report("hosts", args.runs, metrics, args.json)


if __name__ == "__main__":
    main()
