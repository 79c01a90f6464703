"""Coefficients of air and table from recorded flights, (3.29): ros2 run tt_predict identify BAG_OR_FOLDER.

The sum over flights of the mean squared distance between recorded and predicted positions is the least (3.29). The source takes the start
of each flight from its high speed cameras. Here position and velocity at the start are fitted to the flight's own points for every trial of
the coefficients (variable projection). Only the points before the bounce take part, unless a coefficient of the table is asked for. Spin is
the measured one, or, where none was measured, one topspin for each group of equal launches, fitted with the coefficients; such flights tell
C_M times spin, not C_M, and its interval says so. Intervals count flights, not points: errors within a flight go together.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from numba import njit
from scipy.optimize import least_squares
from tt_core.bounce import TableRebound
from tt_core.errors import TtError
from tt_core.events import MOST_BOUNCES, Rows, walk
from tt_core.flight import Aerodynamics
from tt_core.physics import Physics
from tt_core.states import Array

from .landings import up_to_landing
from .recordings import Flight, load

SPIN_UNIT = 100.0  # rad/s, scales the fit
MOST_SPIN = 1000.0  # rad/s
SPINS = (-400.0, -200.0, -80.0, -20.0, 20.0, 80.0, 200.0, 400.0)  # rad/s, topspins that the fit may start from; at 0 (3.3) jumps
START_CORRECTIONS = 3
_RANGES = {
    f"{prefix}.{f.name}": (f.metadata["low"], f.metadata["high"])
    for prefix, model in (("air", Aerodynamics), ("table", TableRebound))
    for f in fields(model)
}
_TINY = np.array([1e-5, 1e-5, 1e-5, 1e-4, 1e-4, 1e-4])  # m, m/s: differences for the Jacobian by the start


@njit(cache=True)
def sample(state: Array, times: Array, air: Array, table: Array, contact: float, rows: Array, at: Rows, out: Array) -> None:
    """Positions (n, 3) at times (n,) s, the first that of state (9,), through bounces; where the path has ended, its end."""
    n, _, _ = walk(times[0], state, times[-1] - times[0] + 1e-9, 0, 0.0, air, table, contact, rows, at)
    i = 1
    for m in range(len(times)):
        while i < n - 1 and rows[i, 0] < times[m]:
            i += 1
        h = rows[i, 0] - rows[i - 1, 0]
        s = min(1.0, (times[m] - rows[i - 1, 0]) / h) if h > 0.0 else 1.0
        for k in range(3):
            p0, p1, m0, m1 = rows[i - 1, 1 + k], rows[i, 1 + k], h * rows[i - 1, 4 + k], h * rows[i, 4 + k]
            out[m, k] = (((2.0 * (p0 - p1) + m0 + m1) * s + 3.0 * (p1 - p0) - 2.0 * m0 - m1) * s + m0) * s + p0


class Predictor:
    """Positions of a ball at given times by one set of coefficients."""

    def __init__(self, physics: Physics) -> None:
        self._model = physics.air.coefficients, physics.table.coefficients, physics.contact_height
        self._rows, self._at = np.empty((4096, 10)), np.empty(MOST_BOUNCES, np.int64)

    def positions(self, state: Array, times: Array) -> Array:
        """(n, 3) m for state (9,) at times[0]."""
        out = np.empty((len(times), 3))
        sample(state, times, *self._model, self._rows, self._at, out)
        return out

    def start(self, flight: Flight, spin: Array, points: int, guess: Array | None = None, corrections: int = START_CORRECTIONS) -> Array:
        """(9,) the state at the flight's first time that fits its first `points` points best, by Gauss and Newton."""
        times, seen = flight.times[:points], flight.positions[:points]
        state = np.concatenate([first_guess(flight) if guess is None else guess[:6], spin])
        for _ in range(corrections):
            base = self.positions(state, times)
            jacobian = np.empty((seen.size, 6))
            for i in range(6):
                moved = state.copy()
                moved[i] += _TINY[i]
                jacobian[:, i] = (self.positions(moved, times) - base).ravel() / _TINY[i]
            state[:6] += np.linalg.lstsq(jacobian, (seen - base).ravel(), rcond=None)[0]
        return state


def first_guess(flight: Flight) -> Array:
    """(6,) position and velocity from a parabola through the first points."""
    t, n = flight.times - flight.times[0], min(len(flight.times), 20)
    line = np.polynomial.polynomial.polyfit(t[:n], flight.positions[:n], 2)
    return np.concatenate([line[0], line[1]])


@dataclass(frozen=True, slots=True, eq=False)
class Identified:
    """physics: with the values found. values, intervals: of `names`, the second half the width of 95 %. spins: rad/s, topspin (-w_y) found
    for each group without a measured one, and the half width. rms: m, of all points, before and after."""

    physics: Physics
    names: tuple[str, ...]
    values: Array
    intervals: Array
    spins: dict[str, tuple[float, float]]
    rms: tuple[float, float]

    def spin(self, flight: Flight) -> Array:
        """(3,) rad/s, measured or that of the flight's group."""
        return flight.spin if flight.spin is not None else np.array([0.0, -self.spins[flight.group][0], 0.0])


def coefficient(physics: Physics, name: str) -> float:
    """Of "air.drag" and the like. Raises TtError for a name that is none."""
    if name not in _RANGES:
        raise TtError(f"coefficient {name!r} is none of {', '.join(_RANGES)}")
    part, _, field = name.partition(".")
    return float(getattr(getattr(physics, part), field))


def with_coefficients(physics: Physics, names: Sequence[str], values: Sequence[float] | Array) -> Physics:
    for name, value in zip(names, values, strict=True):
        part, _, field = name.partition(".")
        physics = replace(physics, **{part: replace(getattr(physics, part), **{field: float(value)})})
    return physics


def identify(
    flights: Sequence[Flight], physics: Physics, names: Sequence[str], tell: Callable[[int, float], None] = lambda trial, rms: None
) -> Identified:
    """Fit the coefficients `names` of `physics`, "air.drag" and the like, to flights.

    names may be empty: then only spins are fitted. tell: called with the trial's number and its rms (m). Raises TtError for no flight and
    for a name that is none.
    """
    if not flights:
        raise TtError("no flight to identify from")
    if not any(name.startswith("table.") for name in names):
        flights = [up_to_landing(flight) for flight in flights]
    groups = sorted({flight.group for flight in flights if flight.spin is None})
    scale = np.array([max(0.05, abs(coefficient(physics, name))) for name in names] + [SPIN_UNIT] * len(groups))
    starts: list[Array | None] = [None] * len(flights)
    weights = np.concatenate([np.full(3 * len(f.times), 1.0 / np.sqrt(len(f.times))) for f in flights])
    trials = 0

    def spin_of(flight: Flight, topspins: Array) -> Array:
        return flight.spin if flight.spin is not None else np.array([0.0, -topspins[groups.index(flight.group)], 0.0])

    def misses(physics: Physics, topspins: Array) -> list[Array]:
        predictor, out = Predictor(physics), []
        for i, flight in enumerate(flights):
            corrections = START_CORRECTIONS if starts[i] is None else 2
            state = predictor.start(flight, spin_of(flight, topspins), len(flight.times), starts[i], corrections)
            starts[i] = state
            out.append((predictor.positions(state, flight.times) - flight.positions).ravel())
        return out

    def residuals(x: Array) -> Array:
        nonlocal trials
        values = x * scale
        everything = np.concatenate(misses(with_coefficients(physics, names, values[: len(names)]), values[len(names) :]))
        trials += 1
        tell(trials, float(np.sqrt(3.0 * np.mean(everything**2))))
        return weights * everything

    topspins = np.zeros(len(groups))
    if groups:
        cost = np.zeros((len(SPINS), len(groups)))
        for row, spin in zip(cost, SPINS, strict=True):
            for flight, miss in zip(flights, misses(physics, np.full(len(groups), spin)), strict=True):
                if flight.spin is None:
                    row[groups.index(flight.group)] += np.mean(miss**2)
        topspins = np.array(SPINS)[np.argmin(cost, axis=0)]
    first = np.concatenate([[coefficient(physics, name) for name in names], topspins]) / scale
    before = residuals(first)
    if len(first) == 0:
        rms = float(np.sqrt(np.mean(before**2)))
        return Identified(physics, (), np.empty(0), np.empty(0), {}, (rms, rms))
    ranges = [_RANGES[name] for name in names] + [(-MOST_SPIN, MOST_SPIN)] * len(groups)
    low, high = np.array(ranges).T / scale
    fit = least_squares(residuals, np.clip(first, low, high), bounds=(low, high), x_scale="jac", diff_step=1e-4, xtol=1e-6, ftol=1e-8)
    half = 1.96 * scale * np.sqrt(np.diag(_covariance(fit.jac, fit.fun, [3 * len(f.times) for f in flights])))
    values, n = fit.x * scale, len(names)
    spins = {group: (float(values[n + i]), float(half[n + i])) for i, group in enumerate(groups)}
    rms_of = [float(np.sqrt(3.0 * np.mean((r / weights) ** 2))) for r in (before, fit.fun)]
    return Identified(with_coefficients(physics, names, values[:n]), tuple(names), values[:n], half[:n], spins, (rms_of[0], rms_of[1]))


def _covariance(jacobian: Array, residual: Array, sizes: Sequence[int]) -> Array:
    """(n, n) by the sandwich rule, each flight one observation (Liang and Zeger 1986)."""
    bread = np.linalg.pinv(jacobian.T @ jacobian)
    cuts = np.cumsum(sizes)[:-1]
    scores = np.array([j.T @ r for j, r in zip(np.split(jacobian, cuts), np.split(residual, cuts), strict=True)])
    count = len(sizes)
    return bread @ (scores.T @ scores) @ bread * count / max(1, count - jacobian.shape[1])


def write_parameters(found: Identified, base: str, path: Path) -> None:
    """YAML for --params-file of every node: the model `base` with the coefficients found."""
    lines = [f"# identified; behind each value half the width of its 95 % interval; rms {1e3 * found.rms[1]:.2f} mm"]
    lines += ["/**:", "  ros__parameters:", f"    physics: {base}"]
    lines += [f"    {n}: {float(v)!r} # {h:.2g}" for n, v, h in zip(found.names, found.values, found.intervals, strict=True)]
    path.write_text("\n".join(lines) + "\n")


def arguments(words: Sequence[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="identify", description="Fit coefficients of air and table to recorded flights.")
    parser.add_argument("source", type=Path, help="a bag (a folder, *.mcap, *.db3 or *.bag), or a folder of *.hdf5 of the aimy launcher")
    parser.add_argument("--topic", default="/ball/state", help="nav_msgs/Odometry of the ball in a bag (default %(default)s)")
    parser.add_argument("--physics", choices=("liu", "measured"), default="liu", help="the model to start from (default %(default)s)")
    parser.add_argument("--coefficients", nargs="+", default=None, metavar="NAME", help=f"of {', '.join(_RANGES)}")
    parser.add_argument("--output", type=Path, default=Path("identified.yaml"), help="parameters for every node (default %(default)s)")
    return parser.parse_args(words)


def main(words: Sequence[str] | None = None) -> int:
    from rich.console import Console
    from rich.table import Table

    args, console = arguments(words), Console(width=None if sys.stdout.isatty() else 120)
    names = args.coefficients or ["air.drag", "air.lift" if args.physics == "liu" else "air.lift_ratio"]
    physics = Physics.liu() if args.physics == "liu" else Physics.measured()
    try:
        flights = load(args.source, args.topic)
        with console.status(f"{len(flights)} flights") as status:
            found = identify(
                flights, physics, names, lambda n, rms: status.update(f"{len(flights)} flights, trial {n}: {1e3 * rms:.2f} mm")
            )
        write_parameters(found, args.physics, args.output)
    except (TtError, OSError) as error:
        print(f"identify: {error}", file=sys.stderr)
        return 2
    table = Table(
        "coefficient", "was", "is", "95 %", title=f"{len(flights)} flights: rms {1e3 * found.rms[0]:.2f} -> {1e3 * found.rms[1]:.2f} mm"
    )
    for name, value, half in zip(found.names, found.values, found.intervals, strict=True):
        table.add_row(name, f"{coefficient(physics, name):.5g}", f"{value:.5g}", f"+- {half:.2g}")
    for group, (spin, half) in found.spins.items():
        table.add_row(f"topspin of {group}, rad/s", "", f"{spin:.0f}", f"+- {half:.2g}")
    console.print(table)
    print(f"wrote {args.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
