"""What the measurement gets wrong, without images: its errors as fitted to rendered balls. ros2 run tt_sim sight WORLD fits them anew.

Each of the nine errors is normal with the variance base + by_spin (|w| / 300 rad/s)^2 + by_speed (|v| / 5 m/s)^2, correlated as fitted. The
time of the measurement needs no fit: it is that of the last frame of the burst, which the geometry tells. Fitted to the catapult's balls of
all scales, 2.5 to 14 m/s; for slower ones it promises too much.
"""

from __future__ import annotations

import argparse
import functools
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import yaml
from numba import njit
from rich.progress import track
from scipy.optimize import nnls
from tt_core.constants import BALL_RADIUS
from tt_core.errors import TtError
from tt_core.flight import fly
from tt_core.physics import Physics
from tt_core.states import Array, BallState
from tt_vision.burst import BurstParams
from tt_vision.camera import Camera
from tt_vision.rig import FRAME_RATE

from .launcher import SCALES

if TYPE_CHECKING:
    from .scenario import Scenario

SPIN, SPEED = 300.0, 5.0  # rad/s, m/s: units of the fit
MARGIN = 2.0  # pixels that an image shows around a whole ball
FEWEST = 50  # measured balls that a fit needs
FRAMES = 60  # after the launch, looked through for the burst
NAMES = tuple(f"{what}_{axis}" for what in ("position", "velocity", "spin") for axis in "xyz")


@dataclass(frozen=True, eq=False)
class Sight:
    """refused: share of balls in view that are not measured. base, by_spin, by_speed: (9,) variances, SI. correlation: (9, 9)."""

    refused: float
    base: Array
    by_spin: Array
    by_speed: Array
    correlation: Array

    @classmethod
    def fitted(cls, errors: Array, speeds: Array, spins: Array, refused: float) -> Sight:
        """errors: (n, 9), measured minus true. speeds: (n,) m/s. spins: (n,) rad/s."""
        causes = np.column_stack([np.ones(len(errors)), (spins / SPIN) ** 2, (speeds / SPEED) ** 2])
        # each square weighs as the inverse of its own expectation, in two passes
        parts = np.zeros((9, 3))
        for i in range(9):
            expected = np.full(len(errors), np.mean(errors[:, i] ** 2))
            for _ in range(3):
                parts[i] = nnls(causes / expected[:, None], errors[:, i] ** 2 / expected)[0]
                expected = np.maximum(causes @ parts[i], 1e-3 * np.mean(errors[:, i] ** 2))
        correlation = np.corrcoef((errors / np.sqrt(causes @ parts.T)).T)
        return cls(refused, parts[:, 0], parts[:, 1], parts[:, 2], correlation)

    @classmethod
    def load(cls, name: str) -> Sight:
        """A file of `sights/`."""
        return _load(name)

    def save(self, file: Path, told: str) -> None:
        parts = zip(self.base, self.by_spin, self.by_speed, strict=True)
        rows = {name: [float(f"{v:.4g}") for v in row] for name, row in zip(NAMES, parts, strict=True)}
        content = {"refused": round(self.refused, 4), "variances": rows, "correlation": np.round(self.correlation, 3).tolist()}
        file.write_text(f"# {told}\n{yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=140)}")

    def sigmas(self, ball: BallState) -> Array:
        """(9,) standard deviations for that ball."""
        spin, speed = ball.spin @ ball.spin / SPIN**2, ball.velocity @ ball.velocity / SPEED**2
        return np.asarray(np.sqrt(self.base + spin * self.by_spin + speed * self.by_speed))

    def measured(self, ball: BallState, rng: np.random.Generator) -> BallState:
        """`ball`, the truth, as it is seen."""
        sigmas = self.sigmas(ball)
        covariance = self.correlation * np.outer(sigmas, sigmas)
        return BallState.from_vector(ball.time, ball.vector + sigmas * (self._root @ rng.standard_normal(9)), covariance)

    @functools.cached_property
    def _root(self) -> Array:
        values, vectors = np.linalg.eigh(self.correlation)
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


@functools.cache
def _load(name: str) -> Sight:
    content = yaml.safe_load((Path(__file__).parent / "sights" / f"{name}.yaml").read_text())
    parts = np.array([content["variances"][key] for key in NAMES]).T
    return Sight(content["refused"], parts[0], parts[1], parts[2], np.array(content["correlation"]))


@njit(cache=True)
def _places(ball: Array, times: Array, air: Array) -> Array:
    """(n, 3) m, of the ball (9,) in free flight at times (n,) s, rising."""
    out, now, last = np.empty((len(times), 3)), ball, 0.0
    for i in range(len(times)):
        now = fly(now, times[i] - last, air)
        last = times[i]
        out[i] = now[:3]
    return out


def last_frame(ball: BallState, cameras: tuple[Camera, ...], physics: Physics, frames: int = BurstParams.frames) -> float | None:
    """s, of the last frame of the burst: the first `frames` that show the whole ball in all images; None when there are not enough."""
    times = np.arange(1, FRAMES) / FRAME_RATE
    places = _places(ball.vector, times, physics.air.coefficients)
    whole = np.ones(len(times), dtype=bool)
    for camera in cameras:
        depth = places @ camera.rotation[2] + camera.translation[2]
        radius = camera.focal_length / camera.pixel_size * BALL_RADIUS / depth + MARGIN
        u, v = camera.project(places).T
        whole &= (u > radius) & (v > radius) & (u < camera.width - 1 - radius) & (v < camera.height - 1 - radius)
    seen = np.flatnonzero(whole)
    return None if len(seen) < frames else ball.time + float(times[seen[frames - 1]])


def errors_seen(scenario: Scenario, seed: int) -> tuple[bool, Array | None]:
    """Of one rendered ball: whether it passes the cameras; and error (9,), speed and spin (11,), None when it was not measured."""
    from .episode import Trial

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
    from .scenario import load

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
