"""The two experiments of dissertation Table 4.5, replayed as scenarios beside what is printed. scripts/bench experiments"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from report import arguments, report
from rich.console import Console
from rich.table import Table
from tt_eval.episode import play
from tt_eval.scenario import Scenario, load
from tt_sim.world.outcome import Result

PRINTED = {"back": (2.10, 0.78, 0.622), "top": (1.90, 0.744, 0.451)}  # landing x, y (m) and time (s), Section 4.5.2


def landings(scenario: Scenario, runs: int) -> np.ndarray:
    """(n, 3) x, y, time of the returns."""
    rows = []
    for seed in range(runs):
        outcome = play(scenario, seed).outcome
        if outcome.result is Result.RETURNED and outcome.hit and outcome.landing:
            rows.append([*outcome.landing.before.position[:2], outcome.landing.before.time - outcome.hit.before.time])
    return np.array(rows).reshape(-1, 3)


def main() -> None:
    args = arguments("experiments", 20)
    table, metrics = Table("ball", "who", "returned", "x, m", "y, m", "time, s", "off, cm", "time off, ms"), dict[str, float]()
    for kind, printed in PRINTED.items():
        scenario = load(f"experiment_{kind}")
        goal, real = scenario.goal, load("real", robot="measured")
        assert goal is not None
        window = scenario.intercept
        ours = {
            "SAM, liu world": scenario,
            "exact, liu world": replace(scenario, robot=replace(scenario.robot, stroke="exact")),
            "SAM, real world": replace(scenario, world=real.world),
            "exact, real world": replace(scenario, world=real.world, robot=replace(real.robot, intercept=window)),
        }
        rows = {"printed": np.array([printed])} | {name: landings(s, args.runs) for name, s in ours.items()}
        asked = np.array([*goal.landing, goal.flight_time])
        table.add_row(kind, "asked", "", *(f"{v:.3f}" for v in asked), "", "")
        for name, found in rows.items():
            if len(found) == 0:
                table.add_row(kind, name, f"0 of {args.runs}", *[""] * 5)
                continue
            mean, spread = found.mean(axis=0), found.std(axis=0)
            off = float(np.median(np.hypot(*(found[:, :2] - asked[:2]).T)))
            late = float(np.median(np.abs(found[:, 2] - asked[2])))
            cells = [f"{m:.3f}" + (f" ± {s:.3f}" if len(found) > 1 else "") for m, s in zip(mean, spread, strict=True)]
            runs = "" if name == "printed" else f"{len(found)} of {args.runs}"
            table.add_row(kind, name, runs, *cells, f"{100 * off:.1f}", f"{1e3 * late:.0f}")
            key = f"{kind}_{name.replace(',', '').replace(' ', '_').lower()}"
            metrics[f"{key}_landing_error_m"], metrics[f"{key}_time_error_s"] = off, late
    Console(width=140).print(table)
    report("experiments", args.runs, metrics, args.json)


if __name__ == "__main__":
    main()
