"""Fits the measurement's error model to rendered balls: ros2 run tt_sim sight SCENARIO --out FILE."""

from __future__ import annotations

import argparse
import functools
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.progress import track
from tt_core.errors import TtError
from tt_core.flight import fly
from tt_core.states import Array

from .episode import Trial
from .launcher import SCALES
from .scenario import Scenario, load
from .sight import Sight, last_frame

FEWEST = 50  # measured balls that a fit needs


def errors_seen(scenario: Scenario, seed: int) -> tuple[bool, Array | None]:
    """Of one rendered ball: whether it passes the cameras; and error (9,), speed and spin (11,), None when it was not measured."""
    trial = Trial.drawn(scenario, seed)
    passes = last_frame(trial.ball, trial.cameras, trial.physics) is not None
    measured = trial.seen()[1] if passes else None
    if measured is None:
        return passes, None
    true = fly(trial.ball.vector, measured.time - scenario.world.cameras.clock_offset - trial.ball.time, trial.physics.air.coefficients)
    return passes, np.array([*(measured.vector - true), np.linalg.norm(true[3:6]), np.linalg.norm(true[6:])])


def fit(scenario: Scenario, balls: int) -> Sight:
    """From that many rendered balls of all scales, on all cores. Raises TtError when hardly any is measured."""
    scenario = replace(scenario, scale=tuple(range(SCALES[0], SCALES[1] + 1)))
    with ProcessPoolExecutor() as pool:
        seen = pool.map(functools.partial(errors_seen, scenario), range(balls), chunksize=4)
        done = list(track(seen, total=balls, description="balls"))
    rows = np.array([row for _, row in done if row is not None])
    if len(rows) < FEWEST:
        raise TtError(f"{len(rows)} of {balls} balls were measured, {FEWEST} needed")
    return Sight.fitted(rows[:, :9], rows[:, 9], rows[:, 10], 1.0 - len(rows) / sum(passes for passes, _ in done))


def main() -> None:
    parser = argparse.ArgumentParser(prog="sight", description=__doc__)
    parser.add_argument("scenario", help="whose cameras see the balls")
    parser.add_argument("--balls", type=int, default=600, help="rendered for the fit (default 600)")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="the model, as YAML")
    args = parser.parse_args()
    if args.balls < FEWEST:
        parser.error(f"--balls {args.balls} is less than {FEWEST}")
    fit(load(args.scenario), args.balls).save(args.out, f"Fitted to {args.balls} rendered balls: ros2 run tt_sim sight {args.scenario}")
    print(args.out)


if __name__ == "__main__":
    main()
