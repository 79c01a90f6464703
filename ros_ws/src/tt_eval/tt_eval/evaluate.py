"""Evaluate sweeps: tables, and a page of figures. ros2 run tt_eval evaluate liu.parquet real.parquet --page out.html."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
import pyarrow.parquet as pq
import rich.table
from pyarrow import ArrowException
from rich.console import Console
from tt_core.constants import NET_HEIGHT, NET_X, TABLE_LENGTH, TABLE_WIDTH
from tt_core.errors import TtError
from tt_core.states import Array
from tt_sim.cameras.tracking_cameras import believed
from tt_sim.world.outcome import Outcome
from tt_vision.camera import triangulate

from .episode import Episode, play
from .miss import Miss
from .page import BLUE, GREEN, GREY, ORANGE, WHOLE_WIDTH, Section, Table, html_page, write_page
from .scenario import load
from .sweep_metrics import NUMBERS, TEXTS

RETURNS = (
    "balls", "hit, %", "on the table, %", "landing off, cm: median", "landing off, cm: 95 %", "flight time off, ms: median",
    "flight time off, ms: 95 %", "spin off, rad/s: median", "spin off, rad/s: 95 %", "missed because",
)  # fmt: skip
SCORING_ERRORS = (
    "landing x, mm",
    "landing y, mm",
    "flight time, ms",
    "spin about y, rad/s",
    "spin about z, rad/s",
    "miss told otherwise, balls",
)
ROBOT = (
    "measured, %", "measured spin off, rpm: median", "measured spin off, rpm: 95 %", "its speed within 200 rpm, %",
    "its axis within 15 deg, %", "arm waits again after, s: 95 %",
)  # fmt: skip
AXIS = 14.07  # deg, acos 0.97: the dissertation's 15 deg (Section 2.5.1)
SHOWN = 2000  # balls of a sweep that are drawn as dots; browsers show few figures that use the graphics card


@dataclass(frozen=True, eq=False)
class Sweep:
    """Results of a sweep, the simulation of many balls of one scenario.

    Attributes:
        name: Name of the scenario.
        numbers: (n,) values of all balls for each column of NUMBERS.
        misses: Why each ball did not come back, in truth; None for a return.
        judged: The same by the wide cameras.
        limits: What kept the arm from the best stroke for each ball, code and joint, see `sweep_metrics.limit`.
    """

    name: str
    numbers: dict[str, Array]
    misses: list[Miss | None]
    judged: list[Miss | None]
    limits: list[tuple[str, str]]

    @classmethod
    def read(cls, file: Path) -> Sweep:
        """Read the file of a sweep.

        Raises:
            TtError: It is no file of `ros2 run tt_eval sweep`.
        """
        try:
            table = pq.read_table(file)
        except (ArrowException, OSError) as error:
            raise TtError(f"{file} is no Parquet file: {str(error).splitlines()[0]}") from error
        missing = [name for name in (*TEXTS, *NUMBERS) if name not in table.column_names]
        if missing:
            raise TtError(f"{file} has no column {missing[0]}: sweep it again")
        name = (table.schema.metadata or {}).get(b"scenario", file.stem.encode()).decode()
        misses, judged = ([Miss(word) if word else None for word in table[name].to_pylist()] for name in ("miss", "judged_miss"))
        limits = list(zip(table["limit"].to_pylist(), table["limit_joint"].to_pylist(), strict=True))
        return cls(name, {column: table[column].to_numpy() for column in NUMBERS}, misses, judged, limits)


def percentiles(values: Array, scale: float = 1.0) -> tuple[float, float]:
    """Return median and 95 % percentile of the absolute values that are finite, multiplied by `scale`; NaN if no value is finite."""
    there = np.abs(values[np.isfinite(values)]) * scale
    return (float(np.median(there)), float(np.percentile(there, 95))) if len(there) else (float("nan"), float("nan"))


def why(misses: Sequence[Miss | None]) -> dict[Miss, int]:
    """Count how often each kind of failure to return a ball occurs, the most frequent first."""
    counts = {miss: list(misses).count(miss) for miss in Miss}
    return {miss: n for miss, n in sorted(counts.items(), key=lambda item: -item[1]) if n}


def _cell(value: float, digits: int = 1) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else "-"


def returns(numbers: dict[str, Array], misses: Sequence[Miss | None], who: str = "") -> list[str]:
    """Return one column of the table that tells how well balls were returned, with a cell for each of its rows, RETURNS.

    Args:
        numbers: (balls,) values of each figure of the sweep, by its name.
        misses: Kind of failure for each ball; None for a return.
        who: Prefix of the names of the figures: "" for what was true, "judged_" for what two simulated wide cameras measured.
    """
    asked = np.isfinite(numbers["asked_x"]).any()  # a sweep of the measurement alone asks for no return
    shares = [100.0 * float(numbers[f"{who}{name}"].mean()) if asked else float("nan") for name in ("hit", "landed")]
    errors = (("landing_error", 100.0), ("time_error", 1e3), ("return_spin_error", 1.0))
    cells = [_cell(v) for v in (*shares, *(v for name, scale in errors for v in percentiles(numbers[f"{who}{name}"], scale)))]
    return [str(len(misses)), *cells, ", ".join(f"{miss} {n}" for miss, n in why(misses).items()) or "none"]


def scoring_errors(sweep: Sweep) -> list[str]:
    """Return a column of the table of the judge's errors: the cells for the rows SCORING_ERRORS.

    The judge is the evaluation by the wide cameras. Its errors are judged minus true values, given as mean and standard deviation over the
    balls that were returned in both.
    """
    cells = []
    for name, scale in (("landing_x", 1e3), ("landing_y", 1e3), ("flight_time", 1e3), ("spin_y", 1.0), ("spin_z", 1.0)):
        off = scale * (sweep.numbers[f"judged_{name}"] - sweep.numbers[name])
        off = off[np.isfinite(off)]
        cells.append(f"{off.mean():+.2f} ± {off.std():.2f}" if len(off) else "-")
    return [*cells, str(sum(one != other for one, other in zip(sweep.misses, sweep.judged, strict=True)))]


def robot(numbers: dict[str, Array]) -> list[str]:
    """Return a column of the table of measurement and arm: the cells for the rows ROBOT. `numbers` are by column of NUMBERS."""
    seen = numbers["seen"] == 1.0
    speed, axis = np.abs(numbers["measured_speed_error_rpm"][seen]) < 200.0, numbers["measured_axis_error_deg"][seen] < AXIS
    shares = [100.0 * float(np.mean(right)) if len(right) else float("nan") for right in (speed, axis)]
    spin, back = percentiles(numbers["measured_spin_error_rpm"]), percentiles(numbers["arm_back"])[1]
    return [*(_cell(v) for v in (100.0 * float(seen.mean()), *spin, *shares)), _cell(back, 2)]


def sweep_tables(sweeps: Sequence[Sweep]) -> list[Table]:
    """Return the tables of all sweeps, with one or two columns for each sweep."""
    heads = [head for sweep in sweeps for head in (sweep.name, "as judged")]
    cells = [c for s in sweeps for c in (returns(s.numbers, s.misses), returns(s.numbers, s.judged, "judged_"))]
    names = ("", *(sweep.name for sweep in sweeps))
    return [
        Table(("", *heads), list(zip(RETURNS, *cells, strict=True)), "Returns: the truth, and as judged by two wide cameras"),
        Table(
            names, list(zip(SCORING_ERRORS, *map(scoring_errors, sweeps), strict=True)), "The judge's own error: mean ± standard deviation"
        ),
        Table(names, list(zip(ROBOT, *(robot(sweep.numbers) for sweep in sweeps), strict=True)), "Measurement and arm"),
    ]


def _field(figure: go.Figure, height: float | None = None) -> None:
    """Draw the table and its net from above, or from the side if the `height` (m) of the net is given."""
    low, high = (0.0, TABLE_WIDTH) if height is None else (0.0, height)
    figure.add_shape(type="rect", x0=0, x1=TABLE_LENGTH, y0=low, y1=high if height is None else 0.0, line={"color": BLUE})
    figure.add_shape(type="line", x0=NET_X, x1=NET_X, y0=low, y1=high, line={"color": GREY})


def _dots(x: Array, y: Array, title: str, x_title: str, y_title: str) -> go.Figure:
    """Return a figure with a dot for each ball."""
    marker = {"size": 4, "color": BLUE, "opacity": 0.4}
    figure = go.Figure().add_scatter(x=_short(x), y=_short(y), mode="markers", marker=marker)
    figure.update_xaxes(title_text=x_title).update_yaxes(title_text=y_title)
    return figure.update_layout(title=title, showlegend=False, height=330)


def _short(values: Array) -> Array:
    """Return values with the digits that a figure shows, which halves the page."""
    return values.astype(np.float32)


def scatter(numbers: dict[str, Array]) -> go.Figure:
    """Return a figure of the places where returns land on the table, true and judged, with the wanted places over them."""
    figure = go.Figure()
    _field(figure)
    for name, who, colour in (("true", "", BLUE), ("judged", "judged_", ORANGE)):
        marker = {"size": 4, "color": colour, "opacity": 0.4, "symbol": "circle" if not who else "cross-thin", "line": {"color": colour}}
        marker["line"]["width"] = 1 if who else 0  # type: ignore[index]
        x, y = (_short(numbers[f"{who}landing_{axis}"]) for axis in "xy")
        figure.add_scatter(x=x, y=y, mode="markers", marker=marker, name=name)
    asked = np.unique(np.column_stack([numbers["asked_x"], numbers["asked_y"]])[np.isfinite(numbers["asked_x"])], axis=0)
    ring = {"symbol": "circle-open", "size": 18, "color": GREEN, "line": {"width": 4}}
    figure.add_scatter(x=asked[:, 0], y=asked[:, 1], mode="markers", marker=ring, name="asked")
    figure.update_yaxes(title_text="y, m", scaleanchor="x", range=[-0.1, TABLE_WIDTH + 0.1])
    figure.update_xaxes(title_text="x, m (the robot is left)", range=[-0.1, TABLE_LENGTH + 0.1])
    return figure.update_layout(title="Landing places", height=560, meta=WHOLE_WIDTH)


def causes(numbers: dict[str, Array]) -> list[go.Figure]:
    """Return figures of the errors of landing and measured spin against spin and speed of the launched ball."""
    errors = (("landing_error", 100.0, "landing off, cm"), ("measured_spin_error_rpm", 1.0, "measured spin off, rpm"))
    return [
        _dots(numbers[cause], scale * numbers[error], f"{name.capitalize()}, against {title}", f"{title} of the launched ball", name)
        for error, scale, name in errors
        for cause, title in (("spin_rpm", "spin, rpm"), ("speed", "speed, m/s"))
        if np.isfinite(numbers[error]).any()
    ]


def scoring_error_figures(numbers: dict[str, Array]) -> list[go.Figure]:
    """Return figures of the errors of the evaluation by the wide cameras, ball by ball: landing place, flight time, spin."""
    off = {name: numbers[f"judged_{name}"] - numbers[name] for name in ("landing_x", "landing_y", "flight_time", "spin_y", "spin_z")}
    begin = "The judge's own error: judged minus true "
    times = go.Figure().add_histogram(x=_short(1e3 * off["flight_time"]), marker_color=BLUE)
    times.update_xaxes(title_text="ms").update_yaxes(title_text="balls").update_layout(title=f"{begin}flight time", height=330)
    return [
        _dots(1e3 * off["landing_x"], 1e3 * off["landing_y"], f"{begin}landing place", "x, mm", "y, mm"),
        times,
        _dots(off["spin_y"], off["spin_z"], f"{begin}spin", "about y, rad/s", "about z, rad/s"),
    ]


def reasons(misses: Sequence[Miss | None], judged: Sequence[Miss | None]) -> go.Figure:
    """Return a figure that shows how often balls were not returned for each reason, true and judged."""
    true, judged_counts = why(misses), why(judged)
    names = [*true, *(name for name in judged_counts if name not in true)]
    figure = go.Figure()
    for name, counts, colour in (("true", true, BLUE), ("judged", judged_counts, ORANGE)):
        figure.add_bar(x=[miss.value for miss in names], y=[counts.get(miss, 0) for miss in names], name=name, marker_color=colour)
    if not names:
        figure.add_annotation(text="none was missed", showarrow=False, font={"size": 16}, xref="paper", yref="paper", x=0.5, y=0.5)
        figure.update_xaxes(visible=False).update_yaxes(visible=False)
    return figure.update_layout(title="Why balls were missed", height=360, yaxis_title="balls")


def one_ball(episode: Episode) -> list[go.Figure]:
    """Return figures of one ball like dissertation Figures 4.7 to 4.10: from the side, from above, and the return over time.

    Dots are positions that the wide cameras saw, lines are the fitted flights. The wanted place is grey, the wanted time green.
    """
    seen = np.column_stack([episode.sightings.times, triangulate(believed(), episode.sightings.pixels)])
    judged, goal, air = episode.judged, episode.goal, episode.trial.scenario.world.physics.air.coefficients
    hit, fit = judged.hit.before.time if judged.hit else np.inf, flown(judged, air)
    fit = fit[fit[:, 0] >= hit]
    figures = []
    for title, axis, name, height in (("From the side", 3, "z, m", NET_HEIGHT), ("From above", 2, "y, m", None)):
        figure = go.Figure()
        _field(figure, height)
        for part, rows, symbol, colour in (
            ("coming", seen[seen[:, 0] <= hit], "star", BLUE),
            ("returning", seen[seen[:, 0] > hit], "circle", GREEN),
        ):
            marker = {"symbol": symbol, "size": 5, "color": colour}
            figure.add_scatter(x=rows[:, 1], y=rows[:, axis], name=part, mode="markers", marker=marker)
        figure.add_scatter(x=fit[:, 1], y=fit[:, axis], name="fitted", line={"color": ORANGE})
        figure.update_xaxes(title_text="x, m (the robot is left)").update_yaxes(title_text=name, scaleanchor="x")
        figures.append(figure.update_layout(title=title, height=380))
    if goal is None:
        return figures
    rows = seen[seen[:, 0] > hit]
    wanted = (*goal.landing, episode.trial.scenario.robot.physics.contact_height)
    for k, name in enumerate("xyz"):
        figure = go.Figure()
        figure.add_scatter(x=rows[:, 0] - hit, y=rows[:, k + 1], mode="markers", marker={"size": 4, "color": BLUE}, name="seen")
        figure.add_scatter(x=fit[:, 0] - hit, y=fit[:, k + 1], line={"color": ORANGE}, name="fitted")
        figure.add_hline(y=wanted[k], line={"color": GREY}).add_vline(x=goal.flight_time, line={"color": GREEN})
        figure.update_xaxes(title_text="s after the hit").update_yaxes(title_text=f"{name}, m")
        figures.append(figure.update_layout(title=f"{name} after the hit; lines: asked place and time", height=330))
    return figures


def flown(outcome: Outcome, air: Array, step: float = 0.005) -> Array:
    """Return the positions of a ball from launch to landing.

    Args:
        outcome: Flight of the ball.
        air: (8,) coefficients of the air, `Aerodynamics.coefficients`.
        step: s, between two positions; those at contacts are added.

    Returns:
        (n, 4) time (s) and position (m) in `table`.
    """
    start = outcome.launched.time
    end = outcome.landing.before.time if outcome.landing else outcome.followed_until(start + 1.0)
    contacts = [contact.before.time for contact in outcome.contacts if contact.before.time < end]
    times = np.unique([*np.arange(start, end, step), *contacts, end])
    return np.column_stack([times, outcome.places(times, air)])


def sweep_page(sweeps: Sequence[Sweep], ball: Episode | None = None) -> str:
    """Return an HTML page with tables and figures of sweeps, and with figures of one ball if it is given."""
    sections = [Section("", tables=sweep_tables(sweeps))]
    for s in sweeps:
        shown, landed = {name: column[:SHOWN] for name, column in s.numbers.items()}, s.numbers["landed"].any()
        figures = [scatter(shown), *causes(shown), *scoring_error_figures(shown)] if landed else causes(shown)
        dots = f"Dots are the first {SHOWN} of {len(s.misses)} balls." if len(s.misses) > SHOWN else ""
        sections.append(Section(f"Sweep of {s.name}", text=[dots] if dots else (), figures=[*figures, reasons(s.misses, s.judged)]))
    if ball is not None:
        title = f"One ball as two wide cameras saw it, {ball.trial.kind} {ball.trial.scale} (Figures 4.7 to 4.10)"
        sections.append(Section(title, figures=one_ball(ball)))
    return html_page("Rallies", sections, lead=[sweep_summary(s) for s in sweeps])


def sweep_summary(sweep: Sweep) -> str:
    """Return a sentence that summarizes the results of a sweep."""
    count = len(sweep.misses)
    if not np.isfinite(sweep.numbers["asked_x"]).any():
        seen = 100.0 * float(sweep.numbers["seen"].mean())
        return f"{sweep.name}: {count} balls were measured only, {seen:.1f} % of them with success."
    hit, landed = (100.0 * float(sweep.numbers[name].mean()) for name in ("hit", "landed"))
    off = _cell(percentiles(sweep.numbers["landing_error"], 100.0)[0])
    shares = f"{hit:.1f} % were hit and {landed:.1f} % landed on the table"
    return f"{sweep.name}: of {count} balls {shares}, {off} cm from where asked (median)."


def main() -> None:
    """Run the command evaluate."""
    parser = argparse.ArgumentParser(prog="evaluate", description=__doc__)
    parser.add_argument("files", type=Path, nargs="+", help="of `ros2 run tt_eval sweep`")
    parser.add_argument("--page", type=Path, metavar="FILE", help="figures, as HTML")
    parser.add_argument("--ball", default="liu", metavar="SCENARIO", help="of the one ball on the page (default liu)")
    parser.add_argument("--seed", type=int, default=1, help="of that ball (default 1: back spin)")
    args = parser.parse_args()
    try:
        sweeps = [Sweep.read(file) for file in args.files]
        ball = play(load(args.ball, images=False), args.seed) if args.page else None
    except TtError as error:
        print(f"evaluate: {error}", file=sys.stderr)
        raise SystemExit(2) from None
    for table in sweep_tables(sweeps):
        printed = rich.table.Table(*table.head, title=table.title, title_justify="left")
        for row in table.rows:
            printed.add_row(*row)
        Console().print(printed)
    if args.page:
        write_page(args.page, sweep_page(sweeps, ball))
        print(args.page)


if __name__ == "__main__":
    main()
