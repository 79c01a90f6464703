"""Stalls of arm_node's process at random moments of a rally: none may latch the arm, and the next ball is played. scripts/bench stalls

--runs stalls of 20 to 500 ms.
"""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

import numpy as np
from graph import RECOVERY, Graph
from report import arguments, report
from tt_bringup.demo import free_domain

RATE = 40.0  # balls a minute
SHORTEST, LONGEST = 0.02, 0.5  # s


def main() -> None:
    args = arguments("stalls", 200)
    free_domain()
    rng, path = np.random.default_rng(0), args.json and args.json.absolute()
    latched, played, broken = 0, [], 0
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        with Graph(Path(tempfile.gettempdir()) / "stalls.log", rate=RATE, given={"record": "false"}) as graph:
            watch = graph.watch
            for run in range(args.runs):
                graph.pause(rng.uniform(0.0, 60.0 / RATE))
                phase, duration = watch.phase, rng.uniform(SHORTEST, LONGEST)
                graph.freeze("arm", duration)
                over = time.time()
                if graph.until(lambda since=over: watch.hit_since(since), RECOVERY):  # type: ignore[misc]
                    played.append(next(ball.hit for ball in tuple(watch.balls) if ball.launched > over))
                else:
                    latched += 1
                    words = [w.text for w in watch.warnings if w.name.startswith("arm")]
                    print(
                        f"{run}: {duration:.3f} s, {phase}: no hit in {RECOVERY:g} s, last word: {words[-1] if words else 'none'}",
                        flush=True,
                    )
                    graph.enable()
            if bound := watch.broken():
                broken = 1
                print(bound)
        os.chdir("/")
    metrics = {
        "stalls": float(args.runs),
        "latched": float(latched),
        "next_ball_hit_share": float(np.mean(played)) if played else 0.0,
        "bounds_broken": float(broken),
    }
    report("stalls", args.runs, metrics, path)
    raise SystemExit(1 if latched or broken else 0)


if __name__ == "__main__":
    main()
