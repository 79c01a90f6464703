"""What each part of the method is worth: other robots on the same balls, one row each. scripts/bench baselines"""

from __future__ import annotations

import functools

import numpy as np
from report import arguments, report
from rich.console import Console
from rich.table import Table
from tt_eval.evaluate import RETURNS, percentiles, returns
from tt_eval.miss import Miss
from tt_eval.process_pool import process_pool
from tt_eval.scenario import load
from tt_eval.sweep import simulate_balls
from tt_eval.sweep_metrics import NUMBERS

CHUNK = 25
ROWS = (  # world, robot, what it is
    ("liu", "liu", "ours"),
    ("liu", "sam", "SAM for the flight"),
    ("liu", "newton", "Newton's posture, pseudo-inverse"),
    ("liu", "spinless", "spin ignored"),
    ("liu", "gravity", "gravity only"),
    ("liu", "specular", "specular, 30 % loss, gravity only"),
    ("real", "measured", "ours, real world, models of real balls"),
    ("real", "liu", "ours, real world, the dissertation's models"),
    ("real", "spinless", "spin ignored, real world"),
)


def main() -> None:
    args = arguments("baselines", 1000)
    table, metrics = Table("robot", *RETURNS), dict[str, float]()
    chunks = [(first, min(first + CHUNK, args.runs)) for first in range(0, args.runs, CHUNK)]
    with process_pool() as pool:
        for world, robot, name in ROWS:
            scenario = load("liu", robot=robot, world=world, images=False)
            rows = [row for t in pool.map(functools.partial(simulate_balls, scenario), *zip(*chunks, strict=True)) for row in t.to_pylist()]
            numbers = {key: np.array([row[key] for row in rows]) for key in NUMBERS}
            table.add_row(name, *returns(numbers, [Miss(row["miss"]) if row["miss"] else None for row in rows]))
            key = f"{world}_{robot}"
            metrics |= {f"{key}_landed_share": float(numbers["landed"].mean()), f"{key}_hit_share": float(numbers["hit"].mean())}
            metrics[f"{key}_landing_error_median"], metrics[f"{key}_landing_error_p95"] = percentiles(numbers["landing_error"])
    Console(width=220).print(table)
    there = {key: value for key, value in metrics.items() if np.isfinite(value)}  # no landings, no error
    report("baselines", args.runs, there, args.json)


if __name__ == "__main__":
    main()
