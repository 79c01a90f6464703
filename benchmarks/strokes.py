"""Strokes as they come in play, made by an arm with lag and noise: how many, how well, and whether a limit is ever broken."""

from __future__ import annotations

from collections import Counter

import numpy as np
from report import arguments, report
from rich.console import Console
from tt_arm.control import warm
from tt_arm.model import ArmModel
from tt_sim.drill import drill, strokes
from tt_sim.launcher import KINDS
from tt_sim.plant import PlantParams

MODEL = ArmModel.pa10()
NOISY = PlantParams(time_constant=0.007, q_noise=5e-5, qdot_noise=5e-3)  # 2 ms slower than the servo believes
SCALES = (3, 4, 5)


def main() -> None:
    given = arguments("strokes", 1000)
    warm(MODEL)
    metrics: dict[str, float] = {}
    done, why, guarded = [], Counter(), Counter()
    shots = [(kind, scale) for kind in KINDS for scale in SCALES]
    made: Counter[tuple[str, int]] = Counter()
    tried: Counter[tuple[str, int]] = Counter()
    for seed in range(given.runs):
        shot = shots[seed % len(shots)]
        one = drill(MODEL, strokes(*shot, seed), NOISY, seed)
        done.append(one)
        tried[shot] += 1
        made[shot] += one.reason is None
        guarded.update(one.guarded)
        if one.reason is not None:
            why["".join(c for c in one.reason.partition(": ")[2] or one.reason if not c.isdigit())] += 1
    for shot in shots:
        metrics[f"made, {shot[0]} {shot[1]}, %"] = 100.0 * made[shot] / max(1, tried[shot])
    metrics["made, all, %"] = 100.0 * sum(made.values()) / given.runs
    hits = [one for one in done if one.reason is None]
    for name, scale in (("turning", 1.0), ("spare", 1e3), ("back", 1.0), ("miss", 1e3), ("tilt", 180.0 / np.pi)):
        values = scale * np.array([getattr(one, name) for one in hits])
        label = {
            "turning": "face turns, rad/s",
            "spare": "to spare, ms",
            "back": "way back, s",
            "miss": "miss, mm",
            "tilt": "tilt, degrees",
        }[name]
        metrics[f"{label}, median"], metrics[f"{label}, 99 %"] = float(np.median(values)), float(np.quantile(values, 0.99))
    metrics["nearest to a position limit, rad"] = min(one.room for one in done)
    metrics["largest share of a speed limit"] = max(one.speed for one in done)
    metrics["largest acceleration, rad/s^2"] = max(one.acceleration for one in done)
    metrics["least clearance, mm"] = 1e3 * min(one.clear for one in done)
    metrics["strokes in which the guard had to cut"] = float(sum(bool(one.guarded) for one in done))
    for reason, count in why.most_common():
        metrics[f"refused: {reason}"] = float(count)
    Console().print(dict(guarded))
    report("strokes", given.runs, metrics, given.json)


if __name__ == "__main__":
    main()
