"""What sweeps came to: a table, and a page of figures. ros2 run tt_sim evaluate liu.parquet real.parquet --page out.html."""

from __future__ import annotations

import argparse
import html
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
import pyarrow.parquet as pq
from plotly.subplots import make_subplots
from rich.console import Console
from rich.table import Table
from tt_core.constants import NET_X, TABLE_LENGTH, TABLE_WIDTH
from tt_core.flight import fly
from tt_core.states import Array

from .episode import MISSES, Episode, play
from .scenario import load

COLUMNS = (
    "balls", "hit, %", "landed, %", "landing off, cm: median", "95 %", "time off, ms: median", "95 %",
    "spin off, rad/s: median", "95 %", "measured spin off, rpm: 95 %", "arm waits again after, s: 95 %", "missed because",
)  # fmt: skip


Sweep = tuple[str, dict[str, Array], list[str]]


def read(file: Path) -> Sweep:
    """Name of the scenario, the numbers by column, and why each ball was missed, "" for a return."""
    table = pq.read_table(file)
    name = (table.schema.metadata or {}).get(b"scenario", file.stem.encode()).decode()
    numbers = {c: table[c].to_numpy() for c in table.column_names if c not in ("kind", "miss", "reason")}
    return name, numbers, table["miss"].to_pylist()


def percentiles(values: Array, scale: float = 1.0) -> tuple[float, float]:
    """Median and 95 % of the absolute values that are there, times `scale`; NaN without any."""
    there = np.abs(values[np.isfinite(values)]) * scale
    return (float(np.median(there)), float(np.percentile(there, 95))) if len(there) else (float("nan"), float("nan"))


def why(misses: Sequence[str]) -> dict[str, int]:
    """How often each reason of MISSES, the frequent first."""
    counts = {miss: list(misses).count(miss) for miss in MISSES}
    return {miss: n for miss, n in sorted(counts.items(), key=lambda item: -item[1]) if n}


def line(numbers: dict[str, Array], misses: Sequence[str]) -> list[str]:
    """The cells of COLUMNS."""
    landing = percentiles(numbers["landing_error"], 100.0)
    time, spin = percentiles(numbers["time_error"], 1e3), percentiles(numbers["return_spin_error"])
    shares = [f"{100.0 * numbers[name].mean():.1f}" for name in ("hit", "landed")]
    cells = [f"{value:.1f}" for value in (*landing, *time, *spin, percentiles(numbers["measured_spin_error_rpm"])[1])]
    back = f"{percentiles(numbers['arm_back'])[1]:.2f}"
    return [str(len(misses)), *shares, *cells, back, ", ".join(f"{miss} {n}" for miss, n in why(misses).items()) or "none"]


def scatter(numbers: dict[str, Array]) -> go.Figure:
    """Where returns land on the table."""
    figure = go.Figure()
    figure.add_shape(type="rect", x0=0, x1=TABLE_LENGTH, y0=0, y1=TABLE_WIDTH, line={"color": "#1b5e9b"})
    figure.add_shape(type="line", x0=NET_X, x1=NET_X, y0=0, y1=TABLE_WIDTH, line={"color": "#444"})
    marker = {"size": 3, "color": "#1b5e9b", "opacity": 0.4}
    figure.add_scattergl(x=numbers["landing_x"], y=numbers["landing_y"], mode="markers", marker=marker, name="landed")
    figure.add_scatter(
        x=np.unique(numbers["asked_x"]), y=[TABLE_WIDTH / 2], mode="markers", marker={"symbol": "x", "color": "#c0392b"}, name="asked"
    )
    figure.update_yaxes(title_text="y, m", scaleanchor="x")
    return figure.update_layout(title="Landing places", height=520, xaxis_title="x, m (the robot is left)")


def causes(numbers: dict[str, Array]) -> go.Figure:
    """Landing error against spin and speed of the incoming ball."""
    figure = make_subplots(rows=1, cols=2, shared_yaxes=True)
    for column, (name, title) in enumerate((("spin_rpm", "spin, rpm"), ("speed", "speed, m/s")), 1):
        marker = {"size": 3, "color": "#1b5e9b", "opacity": 0.4}
        figure.add_scattergl(x=numbers[name], y=100 * numbers["landing_error"], mode="markers", marker=marker, row=1, col=column)
        figure.update_xaxes(title_text=title, row=1, col=column)
    figure.update_yaxes(title_text="landing off, cm", row=1, col=1)
    return figure.update_layout(title="Error against spin and speed", showlegend=False, height=420)


def reasons(misses: Sequence[str]) -> go.Figure:
    counts = why(misses)
    return go.Figure(go.Bar(x=list(counts), y=list(counts.values()))).update_layout(title="Why balls were missed", height=360)


def one_ball(episode: Episode) -> go.Figure:
    """As dissertation Figures 4.7 to 4.10: the ball from the side and from above, and its returning way over time; lines: as asked."""
    titles = ("from the side", "from above", "x after the hit", "y after the hit", "z after the hit")
    places = [{"colspan": 3}, None, None]
    figure = make_subplots(rows=3, cols=3, specs=[places, places, [{}, {}, {}]], subplot_titles=titles)
    path, outcome, goal = flown(episode), episode.outcome, episode.goal
    hit = outcome.hit.before.time if outcome.hit else np.inf
    for name, rows, colour in (("coming", path[path[:, 0] <= hit], "#1b5e9b"), ("returning", path[path[:, 0] >= hit], "#c0392b")):
        for row, axis in ((1, 3), (2, 2)):
            figure.add_scatter(x=rows[:, 1], y=rows[:, axis], name=name, line={"color": colour}, showlegend=row == 1, row=row, col=1)
        if name == "returning" and len(rows) and goal is not None:
            wanted = (*goal.landing, episode.trial.scenario.robot.physics.contact_height)
            for k in range(3):
                figure.add_scatter(x=rows[:, 0] - hit, y=rows[:, k + 1], line={"color": colour}, showlegend=False, row=3, col=k + 1)
                figure.add_hline(y=wanted[k], line={"color": "#444"}, row=3, col=k + 1)
                figure.add_vline(x=goal.flight_time, line={"color": "#2d8a4e"}, row=3, col=k + 1)
    figure.update_yaxes(title_text="z, m", row=1, col=1).update_yaxes(title_text="y, m", row=2, col=1)
    return figure.update_layout(title=f"One ball, {episode.trial.kind} {episode.trial.scale} (Figures 4.7 to 4.10)", height=860)


def flown(episode: Episode, step: float = 0.005) -> Array:
    """(n, 4) time s and place m of the true ball from launch to landing, every `step` s and at contacts."""
    outcome, air = episode.outcome, episode.trial.physics.air.coefficients
    end = outcome.landing.before.time if outcome.landing else outcome.contacts[-1].before.time if outcome.contacts else 1.0
    rows, now = [], outcome.launched
    for until in [*[c for c in outcome.contacts if c.before.time <= end], None]:
        last = until.before.time if until else end
        times = [*np.arange(now.time, last, step), last] if last > now.time else [last]
        rows += [[t, *fly(now.vector, t - now.time, air)[:3]] for t in times]
        now = until.after if until else now
    return np.array(rows)


STYLE = "body { font-family: sans-serif; max-width: 1200px; margin: 2em auto } td, th { padding: .2em .6em; text-align: left }"


def page(files: Sequence[Path], ball: Episode | None = None) -> str:
    """One HTML page that needs no network."""
    read_files = [read(file) for file in files]
    figures: list[tuple[str, go.Figure]] = [] if ball is None else [("", one_ball(ball))]
    for name, numbers, misses in read_files:
        figures += [(name, scatter(numbers)), (name, causes(numbers)), (name, reasons(misses))]
    parts, last = [], ""
    for i, (name, figure) in enumerate(figures):
        parts += [] if name == last else [f"<h2>{html.escape(name)}</h2>"]
        parts.append(figure.to_html(full_html=False, include_plotlyjs=i == 0))
        last = name
    rows = [("", *(name for name, _, _ in read_files)), *_side_by_side(read_files)]
    cells = ("".join(f"<td>{html.escape(cell)}</td>" for cell in row) for row in rows)
    table = f"<table>{''.join(f'<tr>{row}</tr>' for row in cells)}</table>"
    return f"<!doctype html><meta charset=utf-8><title>Rallies</title><style>{STYLE}</style>{table}{''.join(parts)}"


def _side_by_side(sweeps: Sequence[Sweep]) -> list[tuple[str, ...]]:
    """A row for each of COLUMNS, a cell for each sweep."""
    return list(zip(COLUMNS, *(line(numbers, misses) for _, numbers, misses in sweeps), strict=True))


def main() -> None:
    parser = argparse.ArgumentParser(prog="evaluate", description=__doc__)
    parser.add_argument("files", type=Path, nargs="+", help="of `ros2 run tt_sim sweep`")
    parser.add_argument("--page", type=Path, metavar="FILE", help="figures, as HTML")
    parser.add_argument("--ball", default="liu", metavar="SCENARIO", help="of the one ball on the page (default liu)")
    parser.add_argument("--seed", type=int, default=1, help="of that ball (default 1: back spin)")
    args = parser.parse_args()
    for file in args.files:
        if not file.is_file():
            parser.error(f"{file} is no file")
    sweeps = [read(file) for file in args.files]
    table = Table("scenario", *(name for name, _, _ in sweeps))
    for row in _side_by_side(sweeps):
        table.add_row(*row)
    Console().print(table)
    if args.page:
        args.page.write_text(page(args.files, play(load(args.ball, images=False), args.seed)))
        print(args.page)


if __name__ == "__main__":
    main()
