"""Identify coefficients of air and table from recorded flights, (3.29): ros2 run tt_predict identify BAG_OR_FOLDER.

The cost is the sum over flights of the mean squared distance between recorded and predicted positions (3.29). The dissertation measures
the start of each flight with its high-speed cameras. Here position and velocity at the start are fitted to the points of the flight, for
every trial of the coefficients (variable projection). Only points before the bounce are used, unless a coefficient of the table is asked
for.

The spin is the measured one. If it was not measured, one topspin for each group of equal launches is fitted together with the coefficients.
Such flights determine only the product of the lift coefficient C_M and the spin, so the confidence interval of C_M is wide. The intervals
are computed from the number of flights, not of points, because the errors within a flight are correlated.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numba import njit
from scipy.optimize import least_squares
from tt_core.arrays import POSITION, STATE, TIME, VELOCITY, Array
from tt_core.errors import TtError
from tt_core.events import MOST_BOUNCES, Rows, StopCondition, StopKind, walk
from tt_core.interpolate import hermite
from tt_core.learnt_physics import PHYSICS_NODES
from tt_core.physics import Physics, physics_coefficients

from .coefficients import LEAST_SCALE, RANGES, NoFlights, coefficient, with_coefficients
from .landing_fit import Identification, identify_landings
from .landings import up_to_landing
from .recordings import Flight, load_flights

__all__ = [
    "Identification",
    "Identified",
    "NoFlights",
    "Predictor",
    "coefficient",
    "identify",
    "identify_landings",
    "main",
    "with_coefficients",
    "write_parameters",
]

SPIN_UNIT = 100.0  # rad/s, scale of the spins in the fit
SPIN_BOUND = 1000.0  # rad/s, bound of the fitted spins
START_TOPSPINS = (-400.0, -200.0, -80.0, -20.0, 20.0, 80.0, 200.0, 400.0)  # rad/s, topspins to start from; (3.3) is not continuous at 0
START_CORRECTIONS = 3  # number of Gauss-Newton steps with which the start of a flight is fitted for the first time
MORE_CORRECTIONS = 2  # number of steps from the start that was found with the previous coefficients
_AT_TIME = int(StopKind.TIME)
_TINY = np.array([1e-5, 1e-5, 1e-5, 1e-4, 1e-4, 1e-4])  # m, m/s: differences for the Jacobian by the start


@njit(cache=True)
def _positions_entry(state: Array, times: Array, physics: Array, rows: Array, bounce_rows: Rows, out: Array) -> None:
    """Compute the positions of the ball at given times, through bounces. After the end of the path they are its last position.

    Args:
        state: (9,) state of the ball at the first of `times`.
        times: (n,) s, increasing.
        physics: (19,) `Physics.coefficients`.
        rows: (m, 10) scratch memory for the path.
        bounce_rows: (MOST_BOUNCES,) scratch memory.
        out: (n, 3) m, output: filled with the positions.
    """
    stop = StopCondition(_AT_TIME, 0.0, times[-1] - times[0] + 1e-9)
    n, _, _ = walk(times[0], state, stop, physics_coefficients(physics), rows, bounce_rows)
    i = 1
    for m in range(len(times)):
        while i < n - 1 and rows[i, TIME] < times[m]:
            i += 1
        start, end = rows[i - 1, STATE], rows[i, STATE]
        h = rows[i, TIME] - rows[i - 1, TIME]
        share = min(1.0, (times[m] - rows[i - 1, TIME]) / h) if h > 0.0 else 1.0
        p0, v0, p1, v1 = start[POSITION], start[VELOCITY], end[POSITION], end[VELOCITY]
        for k in range(3):
            out[m, k] = hermite(p0[k], v0[k], p1[k], v1[k], h, share)


class Predictor:
    """Predictor of the positions of a ball at given times, for one set of coefficients."""

    def __init__(self, physics: Physics) -> None:
        """Keep the models and memory for one path."""
        self._physics = physics.coefficients
        self._rows, self._bounce_rows = np.empty((4096, 10)), np.empty(MOST_BOUNCES, np.int64)

    def positions(self, state: Array, times: Array) -> Array:
        """Predict the positions of a ball, through bounces.

        Args:
            state: (9,) state at the first of `times`: position m, velocity m/s, spin rad/s in `table`.
            times: (n,) s, increasing.

        Returns:
            (n, 3) m in `table`. After the end of the path, for example at the floor, they are its last position.
        """
        out = np.empty((len(times), 3))
        _positions_entry(state, times, self._physics, self._rows, self._bounce_rows, out)
        return out

    def start(self, flight: Flight, spin: Array, points: int, guess: Array | None = None, corrections: int = START_CORRECTIONS) -> Array:
        """Fit position and velocity at the start of a flight to its first points by the Gauss-Newton method.

        Args:
            flight: Recorded points of the ball.
            spin: (3,) rad/s in `table`, spin at the start, which is not changed.
            points: Number of points that are used.
            guess: (9,) state from which the fit starts, its spin ignored; None to start from a parabola through the first points.
            corrections: Number of Gauss-Newton steps.

        Returns:
            (9,) state at the flight's first time: position m, velocity m/s, spin rad/s in `table`.
        """
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
    """Return position (m) and velocity (m/s) at the start of a flight as one array (6,), from a parabola fitted to its first 20 points."""
    t, n = flight.times - flight.times[0], min(len(flight.times), 20)
    line = np.polynomial.polynomial.polyfit(t[:n], flight.positions[:n], 2)
    position, velocity, _ = line
    return np.concatenate([position, velocity])


@dataclass(frozen=True, slots=True, eq=False)
class Identified:
    """Coefficients of air and table that were identified from recorded flights.

    Attributes:
        physics: Models with the identified values.
        names: Names of the n fitted coefficients, for example "air.drag".
        values: (n,) identified values, in the units of the coefficients.
        intervals: (n,) half the widths of their 95 % confidence intervals.
        spins: For each group of flights without a measured spin: the fitted topspin (-w_y), and half the width of its 95 % confidence
            interval, in rad/s.
        rms: Root mean square distance in m between predicted and recorded positions, before the fit and after it.
    """

    physics: Physics
    names: tuple[str, ...]
    values: Array
    intervals: Array
    spins: dict[str, tuple[float, float]]
    rms: tuple[float, float]

    def spin(self, flight: Flight) -> Array:
        """Return the spin (3,) rad/s in `table` at the start of a flight: the measured one, or else the one fitted for its group."""
        return flight.spin if flight.spin is not None else _topspin(self.spins[flight.group][0])


def _topspin(value: float) -> Array:
    """Return the spin vector (3,) rad/s for an amount of topspin (rad/s) of a ball that flies to -x."""
    return np.array([0.0, -value, 0.0])


class _Fit:
    """The least squares problem: residuals of all flights as a function of coefficients and spins.

    The unknowns are the values of the coefficients, then one topspin for each group without a measured spin, each divided by its scale.

    Attributes:
        flights: Flights with the points that are used.
        names: Names of the coefficients.
        groups: Names of the groups without a measured spin.
        scale: (n,) scales of the unknowns.
        weights: (m,) weights of all coordinates, such that each flight has the same weight.
    """

    def __init__(self, flights: Sequence[Flight], physics: Physics, names: Sequence[str], report: Callable[[int, float], None]) -> None:
        self.flights, self.physics, self.names = flights, physics, names
        self.groups = sorted({flight.group for flight in flights if flight.spin is None})
        self.scale = np.array([max(LEAST_SCALE, abs(coefficient(physics, name))) for name in names] + [SPIN_UNIT] * len(self.groups))
        self.weights = np.concatenate([np.full(3 * len(f.times), 1.0 / np.sqrt(len(f.times))) for f in flights])
        self._starts: list[Array | None] = [None] * len(flights)
        self._trials, self._report = 0, report

    def misses(self, physics: Physics, topspins: Array) -> list[Array]:
        """Return predicted minus recorded coordinates in m for each flight, after its start was fitted.

        Args:
            physics: Models of air and table.
            topspins: rad/s, one for each group without a measured spin.
        """
        predictor, out = Predictor(physics), []
        for i, flight in enumerate(self.flights):
            spin = flight.spin if flight.spin is not None else _topspin(topspins[self.groups.index(flight.group)])
            corrections = START_CORRECTIONS if self._starts[i] is None else MORE_CORRECTIONS
            state = predictor.start(flight, spin, len(flight.times), self._starts[i], corrections)
            self._starts[i] = state
            out.append((predictor.positions(state, flight.times) - flight.positions).ravel())
        return out

    def first_topspins(self) -> Array:
        """Return for each group without a measured spin the element of START_TOPSPINS (rad/s) that fits its flights best."""
        cost = np.zeros((len(START_TOPSPINS), len(self.groups)))
        for row, spin in zip(cost, START_TOPSPINS, strict=True):
            for flight, miss in zip(self.flights, self.misses(self.physics, np.full(len(self.groups), spin)), strict=True):
                if flight.spin is None:
                    row[self.groups.index(flight.group)] += np.mean(miss**2)
        return np.array(START_TOPSPINS)[np.argmin(cost, axis=0)]

    def first(self) -> Array:
        """Return the unknowns (n,), scaled coefficients and topspins, from which the fit starts."""
        topspins = self.first_topspins() if self.groups else np.zeros(0)
        return np.concatenate([[coefficient(self.physics, name) for name in self.names], topspins]) / self.scale

    def bounds(self) -> tuple[Array, Array]:
        """Return the lower and the upper bounds (n,) of the unknowns, the scaled coefficients and topspins."""
        ranges = [RANGES[name] for name in self.names] + [(-SPIN_BOUND, SPIN_BOUND)] * len(self.groups)
        low, high = np.array(ranges).T / self.scale
        return low, high

    def residuals(self, unknowns: Array) -> Array:
        """Return the weighted residuals (m,) of all flights for scaled coefficients and topspins (n,), and report the trial."""
        values, count = unknowns * self.scale, len(self.names)
        misses = np.concatenate(self.misses(with_coefficients(self.physics, self.names, values[:count]), values[count:]))
        self._trials += 1
        self._report(self._trials, float(np.sqrt(3.0 * np.mean(misses**2))))
        return self.weights * misses

    def rms(self, residuals: Array) -> float:
        """Return the root mean square distance in m between predicted and recorded points, from weighted residuals (m,)."""
        return float(np.sqrt(3.0 * np.mean((residuals / self.weights) ** 2)))

    def covariance(self, jacobian: Array, residuals: Array) -> Array:
        """Return the covariance (n, n) of the unknowns by the sandwich estimator, with each flight as one observation (Liang, Zeger 1986).

        Args:
            jacobian: (m, n) derivatives of the weighted residuals by the unknowns.
            residuals: (m,) weighted residuals.
        """
        bread = np.linalg.pinv(jacobian.T @ jacobian)
        cuts = np.cumsum([3 * len(flight.times) for flight in self.flights])[:-1]
        scores = np.array([j.T @ r for j, r in zip(np.split(jacobian, cuts), np.split(residuals, cuts), strict=True)])
        count = len(self.flights)
        return bread @ (scores.T @ scores) @ bread * count / max(1, count - jacobian.shape[1])


def identify(
    flights: Sequence[Flight], physics: Physics, names: Sequence[str], report: Callable[[int, float], None] = lambda trial, rms: None
) -> Identified:
    """Fit coefficients of air and table to recorded flights.

    Points after the bounce are used only if a coefficient of the table is fitted.

    Args:
        flights: Recorded flights.
        physics: Models from which the fit starts.
        names: Names of the coefficients to fit, for example "air.drag". If it is empty, only the unmeasured spins are fitted.
        report: Callback for progress. It gets the number of each trial and its root mean square distance in m.

    Returns:
        The identified coefficients with their confidence intervals.

    Raises:
        NoFlights: There is no flight.
        BadChoice: A name is not that of a coefficient.
    """
    if not flights:
        raise NoFlights
    if not any(name.startswith("table.") for name in names):
        flights = [up_to_landing(flight) for flight in flights]
    fit = _Fit(flights, physics, names, report)
    first = fit.first()
    before = fit.residuals(first)
    if len(first) == 0:
        return Identified(physics, (), np.empty(0), np.empty(0), {}, (fit.rms(before), fit.rms(before)))
    low, high = fit.bounds()
    found = least_squares(fit.residuals, np.clip(first, low, high), bounds=(low, high), x_scale="jac", diff_step=1e-4, xtol=1e-6, ftol=1e-8)
    half = 1.96 * fit.scale * np.sqrt(np.diag(fit.covariance(found.jac, found.fun)))
    values, n = found.x * fit.scale, len(names)
    spins = {group: (float(values[n + i]), float(half[n + i])) for i, group in enumerate(fit.groups)}
    physics = with_coefficients(physics, names, values[:n])
    return Identified(physics, tuple(names), values[:n], half[:n], spins, (fit.rms(before), fit.rms(found.fun)))


def write_parameters(found: Identified, base: str, path: Path) -> None:
    """Write the identified coefficients to a ROS parameter file for all nodes that use the models.

    Launch files take it by the argument `more_params_file:=`.

    Args:
        found: The identified coefficients.
        base: Name of the models from which the fit started, "liu" or "measured".
        path: Path of the file to write.
    """
    lines = [f"# identified; behind each value half the width of its 95 % interval; rms {1e3 * found.rms[1]:.2f} mm"]
    values = [f"    {n}: {float(v)!r} # {h:.2g}" for n, v, h in zip(found.names, found.values, found.intervals, strict=True)]
    for node in PHYSICS_NODES:
        lines += [f"/**/{node}:", "  ros__parameters:", f"    physics: {base}", *values]
    path.write_text("\n".join(lines) + "\n")


EPILOG = """The output is a file of ROS parameters for the nodes that use the models. Give it to a launch file beside its own, "ros2 launch
tt_bringup sim.launch.yaml more_params_file:=identified.yaml", or to one node with "--ros-args --params-file identified.yaml"."""


def arguments(words: Sequence[str] | None = None) -> argparse.Namespace:
    """Parse the options of the command line, or of `words` if these are given."""
    parser = argparse.ArgumentParser(prog="identify", description="Fit coefficients of air and table to recorded flights.", epilog=EPILOG)
    parser.add_argument("source", type=Path, help="a bag (a folder, *.mcap, *.db3 or *.bag), or a folder of *.hdf5 of the aimy launcher")
    parser.add_argument("--topic", default="/ball/state", help="nav_msgs/Odometry of the ball in a bag (default %(default)s)")
    parser.add_argument("--physics", choices=("liu", "measured"), default="liu", help="the models to start from (default %(default)s)")
    parser.add_argument("--coefficients", nargs="+", default=None, metavar="NAME", help=f"what is fitted: any of {', '.join(RANGES)}")
    parser.add_argument(
        "--output", type=Path, default=Path("identified.yaml"), help="file of ROS parameters that is written (default %(default)s)"
    )
    return parser.parse_args(words)


def main(words: Sequence[str] | None = None) -> int:
    """Run the command `identify` with the options of the command line, or with `words`; return its exit code, 2 after an error."""
    from rich.console import Console
    from rich.table import Table

    args, console = arguments(words), Console(width=None if sys.stdout.isatty() else 120)
    names = args.coefficients or ["air.drag", "air.lift" if args.physics == "liu" else "air.lift_ratio"]
    physics = Physics.liu() if args.physics == "liu" else Physics.measured()
    try:
        flights = load_flights(args.source, args.topic)
        with console.status(f"{len(flights)} flights") as status:
            found = identify(
                flights, physics, names, lambda n, rms: status.update(f"{len(flights)} flights, trial {n}: {1e3 * rms:.2f} mm")
            )
        write_parameters(found, args.physics, args.output)
    except (TtError, OSError) as error:
        print(f"identify: {error}", file=sys.stderr)
        return 2
    table = Table(
        "coefficient", "was", "is", "95 %", title=f"{len(flights)} flights: rms {1e3 * found.rms[0]:.3g} -> {1e3 * found.rms[1]:.3g} mm"
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
