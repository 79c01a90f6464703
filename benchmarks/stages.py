"""Where a measurement spends its time, function by function, and as shares of Method 2 on the same bursts. scripts/bench stages

--runs rendered bursts of six frames of both cameras (default 100). Times are what one core spends, warm, without what is called from there;
a kernel counts with the kernels that it calls. What takes less than 1 % of the measurement is summed up.
"""

from __future__ import annotations

import cProfile
import pstats
import time
from pathlib import Path

import numpy as np
from method2 import method_2
from report import arguments, report
from tt_eval.synthetic_bursts import bursts
from tt_vision.measure import measure_burst
from tt_vision.rig import high_speed_pair
from tt_vision.warm import warm

LEAST = 0.01  # of the measurement
SEED = 0


def main() -> None:
    args = arguments("stages", runs=100)
    warm(high_speed_pair())
    yardstick, whole, profile = [], [], cProfile.Profile(time.thread_time)
    for number, burst in enumerate(bursts(args.runs + 1, seed=SEED)):
        vectors = np.array([camera.vector for camera in burst.cameras])
        times = [time.thread_time()]
        for call in (lambda b=burst, v=vectors: method_2(b.images, b.times, v), lambda b=burst: measure_burst(b.burst)):
            call()
            times.append(time.thread_time())
        if number == 0:  # loads what warm does not
            continue
        yardstick.append(times[1] - times[0])
        whole.append(times[2] - times[1])
        profile.enable()
        measure_burst(burst.burst)
        profile.disable()
    method2, measure = 1e3 * float(np.median(yardstick)), 1e3 * float(np.median(whole))
    metrics = {"method2_ms": method2, "measure_ms_p50": measure, "measure_share_p50": measure / method2}
    rows = {
        f"{Path(file).stem}.{function}": 1e3 * own / args.runs
        for (file, _, function), (_, _, own, *_) in pstats.Stats(profile).stats.items()  # type: ignore[attr-defined]
    }
    shown = {name: ms for name, ms in sorted(rows.items(), key=lambda row: -row[1]) if ms > LEAST * measure}
    shown["everything else"] = sum(rows.values()) - sum(shown.values())
    metrics |= {f"{name}_ms": ms for name, ms in shown.items()}
    metrics |= {f"{name}_share": ms / method2 for name, ms in shown.items()}
    report("stages", args.runs, metrics, args.json)


if __name__ == "__main__":
    main()
