"""Fit the sensor error models to rendered balls, and write all files in `sensor_error_models/`: ros2 run tt_eval fit_sensor_error."""

from __future__ import annotations

import argparse
import functools
import sys
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tt_core.arrays import SPIN, VELOCITY, Array
from tt_core.errors import TtError
from tt_core.flight import fly
from tt_core.states import BallState
from tt_sim.world.launcher import SCALES
from tt_vision.rig import VIEW_CENTRE

from .episode import Trial
from .process_pool import process_pool
from .progress import tracked
from .scenario import HOME, Scenario, load
from .sensor_error_model import SensorErrorModel, last_frame

LEAST_FITTED_BALLS = 50  # least number of measured balls for a fit
SLOW_SPEED = 3.0  # m/s; every other ball of a fit has a speed from 0 to this
SLOW_BALL_SPIN = 700.0  # rad/s, largest spin of these balls, about any axis
SCENARIOS = ("liu", "real", "harsh")  # one for each sensor error model


def draw_ball(scenario: Scenario, seed: int) -> Trial:
    """Draw a ball for the fit at random.

    For even seeds this is a ball of the launcher, its scales in turn; for odd seeds a slow or resting ball in the middle of the view.

    Args:
        scenario: Whose launcher, world and cameras are used.
        seed: Number of the ball.
    """
    number, slow = divmod(seed, 2)
    if not slow:
        return Trial.drawn(replace(scenario, scale=tuple(range(SCALES[0], SCALES[1] + 1))), number)
    rng = np.random.default_rng([seed, 3])
    ways = rng.normal(size=(2, 3))
    way, axis = ways / np.linalg.norm(ways, axis=1)[:, None]
    place = np.array(VIEW_CENTRE) + rng.uniform(-0.01, 0.01, 3)
    ball = BallState(0.0, place, rng.uniform(0.0, SLOW_SPEED) * way, rng.uniform(0.0, SLOW_BALL_SPIN) * axis)
    return Trial.drawn(replace(scenario, shots="given", ball=ball), seed)


class MeasuredError(NamedTuple):
    """Error of one measured ball.

    Attributes:
        error: (9,) measured minus true position (m), velocity (m/s) and spin (rad/s).
        speed: m/s, true speed.
        spin: rad/s, length of the true spin.
    """

    error: Array
    speed: float
    spin: float


def errors_seen(scenario: Scenario, seed: int) -> tuple[bool, MeasuredError | None]:
    """Render and measure one ball of `draw_ball`.

    Args:
        scenario: Whose launcher, world and cameras are used.
        seed: Number of the ball.

    Returns:
        Whether the cameras see enough of it according to `last_frame`; and its error, or None if it was not measured.
    """
    trial = draw_ball(scenario, seed)
    passes = last_frame(trial.ball, trial.cameras, trial.physics) is not None
    measured = trial.seen()[1] if passes else None
    if measured is None:
        return passes, None
    true = fly(trial.ball.vector, measured.time - scenario.world.cameras.clock_offset - trial.ball.time, trial.physics.air.coefficients)
    return passes, MeasuredError(measured.vector - true, float(np.linalg.norm(true[VELOCITY])), float(np.linalg.norm(true[SPIN])))


def fit_sensor_errors(scenario: Scenario, balls: int) -> SensorErrorModel:
    """Fit a sensor error model to rendered balls, on all cores.

    Args:
        scenario: Whose launcher, world and cameras are used.
        balls: Number of balls, see `draw_ball`.

    Raises:
        TtError: Fewer than LEAST_FITTED_BALLS are measured.
    """
    with process_pool() as pool:
        seen = pool.map(functools.partial(errors_seen, scenario), range(balls), chunksize=4)
        done = list(tracked("balls", balls, seen))
    found = [error for _, error in done if error is not None]
    if len(found) < LEAST_FITTED_BALLS:
        raise TtError(f"{len(found)} of {balls} balls were measured, {LEAST_FITTED_BALLS} needed")
    errors, speeds, spins = (np.array(column) for column in zip(*found, strict=True))
    return SensorErrorModel.fitted(errors, speeds, spins, 1.0 - len(found) / sum(passes for passes, _ in done))


def main() -> None:
    """Run the command fit_sensor_error."""
    parser = argparse.ArgumentParser(prog="fit_sensor_error", description=__doc__)
    parser.add_argument("scenarios", nargs="*", metavar="SCENARIO", help=f"whose cameras see the balls (default {', '.join(SCENARIOS)})")
    parser.add_argument("--balls", type=int, default=800, help="rendered for each fit (default 800)")
    parser.add_argument(
        "--out", type=Path, default=HOME / "sensor_error_models", metavar="DIRECTORY", help="of the models (default: where they are read)"
    )
    args = parser.parse_args()
    if args.balls < LEAST_FITTED_BALLS:
        parser.error(f"--balls {args.balls} is less than {LEAST_FITTED_BALLS}")
    try:
        scenarios = [load(name) for name in args.scenarios or SCENARIOS]
        args.out.mkdir(parents=True, exist_ok=True)
        for name, scenario in zip(args.scenarios or SCENARIOS, scenarios, strict=True):
            file = args.out / f"{scenario.world.sensor_error_model}.yaml"
            fit_sensor_errors(scenario, args.balls).save(
                file, f"Fitted to {args.balls} rendered balls: ros2 run tt_eval fit_sensor_error {name}"
            )
            print(file)
    except TtError as error:
        print(f"fit_sensor_error: {error}", file=sys.stderr)
        raise SystemExit(2) from None


if __name__ == "__main__":
    main()
