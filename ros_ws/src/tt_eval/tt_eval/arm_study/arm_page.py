"""Results of the study of an arm: an HTML page, and the same tables in the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from tt_core.states import Array

from ..evaluate import Sweep, percentiles
from ..page import BLUE, GREEN, GREY, ORANGE, WHOLE_WIDTH, Section, Table, html_page
from .limiting import limiting
from .search import Candidate, front
from .speed_map import SpeedMap

SPEED_INTERVAL = 1.0  # m/s, width of an interval of ball speeds for which shares are drawn
LEAST_BALLS = 20  # least number of balls in such an interval; below it no share is drawn


@dataclass(frozen=True, eq=False)
class Study:
    """Results of the study of an arm.

    Attributes:
        name: Name of the arm.
        best: Its best placement.
        candidates: All placements that were tried.
        catapult: Results for balls of the catapult, all scales.
        rallies: Results for shots of real play.
        speeds: Racket speeds that the arm reaches.
    """

    name: str
    best: Candidate
    candidates: Sequence[Candidate]
    catapult: Sweep
    rallies: Sweep
    speeds: SpeedMap


def shares(sweep: Sweep, chosen: Array | None = None) -> tuple[int, float, float, float]:
    """Return the main results of the balls of a sweep.

    Args:
        sweep: The balls.
        chosen: (n,) whether each ball is included; None for all.

    Returns:
        Number of balls, share of hit balls (%), share of balls that landed on the table (%), and median landing error (cm).
    """
    rows = np.ones(len(sweep.misses), bool) if chosen is None else chosen
    hit, landed = (100.0 * float(sweep.numbers[name][rows].mean()) for name in ("hit", "landed"))
    return int(rows.sum()), hit, landed, percentiles(sweep.numbers["landing_error"][rows], 100.0)[0]


def score_table(study: Study) -> Table:
    """Return a table of the results for balls of the catapult, by scale, and for shots of real play."""
    scales = study.catapult.numbers["scale"]
    groups = [(f"catapult, scale {scale:.0f}", study.catapult, scales == scale) for scale in np.unique(scales)]
    rows = [(name, *shares(sweep, chosen)) for name, sweep, chosen in (*groups, ("real play", study.rallies, None))]
    cells = [[name, str(count), *("-" if np.isnan(value) else f"{value:.1f}" for value in values)] for name, count, *values in rows]
    return Table(("balls", "count", "hit, %", "on the table, %", "landing off, cm: median"), cells, "What comes back, world real")


def limits_table(study: Study) -> Table:
    """Return a table of what limits the arm, as shares of the balls."""
    counts = {sweep: limiting(sweep.limits) for sweep in (study.catapult, study.rallies)}
    names = sorted({name for found in counts.values() for name in found}, key=lambda name: -sum(c.get(name, 0) for c in counts.values()))
    rows = [[name, *(f"{100.0 * found.get(name, 0) / len(sweep.misses):.1f}" for sweep, found in counts.items())] for name in names]
    title = "What limits the arm: share of the balls, %, whose best stroke was refused for it"
    return Table(("what", "catapult", "real play"), rows or [["nothing", "", ""]], title)


def placement_table(study: Study) -> Table:
    """Return a table of the best placement: base, mount and waiting posture."""
    one = study.best.placement

    def numbers(values: Sequence[float] | None) -> str:
        return "as in the URDF" if values is None else ", ".join(f"{value:.3f}" for value in values)

    rows = [["base: x, y, z, yaw", numbers(one.base)], ["mount", numbers(one.mount)], ["waiting", numbers(one.waiting)]]
    return Table(("what", "m and rad"), rows, "The best placement")


def against_speed(study: Study) -> go.Figure:
    """Return a figure of the shares of hit and landed balls against the speed of the ball."""
    figure = go.Figure()
    for sweep, dash, name in ((study.catapult, "solid", "catapult"), (study.rallies, "dot", "real play")):
        speed = sweep.numbers["speed"]
        bins = [
            low
            for low in np.arange(0.0, speed.max() + SPEED_INTERVAL, SPEED_INTERVAL)
            if ((speed >= low) & (speed < low + SPEED_INTERVAL)).sum() >= LEAST_BALLS
        ]
        found = [shares(sweep, (speed >= low) & (speed < low + SPEED_INTERVAL)) for low in bins]
        for column, what, colour in ((1, "hit", BLUE), (2, "on the table", GREEN)):
            line = {"color": colour, "dash": dash}
            figure.add_scatter(x=np.array(bins) + 0.5 * SPEED_INTERVAL, y=[row[column] for row in found], name=f"{name}: {what}", line=line)
    figure.update_xaxes(title_text="speed of the launched ball, m/s").update_yaxes(title_text="%", range=[0, 103])
    return figure.update_layout(title="Hit and landed share against ball speed")


def speed_figure(study: Study) -> go.Figure:
    """Return a figure of the racket speeds that the arm reaches, over the middle plane of the hit window."""
    speeds = study.speeds
    figure = go.Figure(go.Heatmap(x=speeds.y, y=speeds.z, z=np.round(speeds.speed, 2), colorscale="Viridis", colorbar={"title": "m/s"}))
    figure.update_xaxes(title_text="y, m (the robot looks away from you)", autorange="reversed").update_yaxes(title_text="z, m")
    return figure.update_layout(title="Racket speed forwards and upwards in the middle of the hit window")


def base_figure(study: Study) -> go.Figure:
    """Return a figure of the base positions that were tried, from above, coloured by their mean share of strokes in time."""
    tried = [one for one in study.candidates if one.placement.waiting is not None or one is study.candidates[0]]
    tried.sort(key=lambda one: one.value(0.5))
    x, y = ([one.placement.base[axis] for one in tried] for axis in (0, 1))
    values = [100.0 * one.value(0.5) for one in tried]
    marker = {"color": values, "colorscale": "Viridis", "size": 7, "colorbar": {"title": "%"}}
    figure = go.Figure(go.Scatter(x=x, y=y, mode="markers", marker=marker, name="tried"))
    best = study.best.placement.base
    ring = {"symbol": "circle-open", "size": 18, "color": ORANGE, "line": {"width": 4}}
    figure.add_scatter(x=[best[0]], y=[best[1]], mode="markers", marker=ring, name="best")
    figure.add_shape(type="rect", x0=0.0, x1=0.6, y0=0.0, y1=1.525, line={"color": GREY})
    figure.update_layout(showlegend=False)
    figure.update_xaxes(title_text="x, m (the table is right)").update_yaxes(title_text="y, m", scaleanchor="x")
    return figure.update_layout(title="Bases that were tried: mean share of both kinds of balls")


def pareto_figure(study: Study) -> go.Figure:
    """Return a figure of the placements: share of strokes in time for the catapult's balls against that for real play.

    The placements for which no other one is better in both are connected by a line.
    """
    figure = go.Figure()
    for chosen, mode, colour, name in (
        (study.candidates, "markers", GREY, "tried"),
        (front(study.candidates), "lines+markers", BLUE, "best of both"),
        ([study.candidates[0]], "markers", ORANGE, "as given"),
        ([study.best], "markers", GREEN, "chosen"),
    ):
        x, y = ([100.0 * getattr(one.score, kind) for one in chosen] for kind in ("catapult", "rallies"))
        figure.add_scatter(x=x, y=y, mode=mode, name=name, marker={"color": colour, "size": 5 if name == "tried" else 9})
    figure.update_xaxes(title_text="catapult, scales 3 to 5: strokes in time, %").update_yaxes(title_text="real play: strokes in time, %")
    return figure.update_layout(title="Catapult against real play")


def arm_summary(study: Study) -> list[str]:
    """Return sentences that summarize what the arm can do."""
    speeds = study.speeds.speed[study.speeds.speed > 0.0]
    lines = [
        f"{study.name}: of {count} {what} {hit:.1f} % are hit and {landed:.1f} % land on the table."
        for what, (count, hit, landed, _) in (
            ("balls of the catapult", shares(study.catapult)),
            ("shots of real play", shares(study.rallies)),
        )
    ]
    if len(speeds):
        joint = max(study.speeds.bounding, key=lambda name: study.speeds.bounding[name])
        reached = 100.0 * len(speeds) / study.speeds.speed.size
        lines.append(
            f"The racket reaches {reached:.0f} % of the hit window, there with {np.median(speeds):.1f} m/s in the median and "
            f"{speeds.min():.1f} m/s at least; mostly joint {joint} bounds it."
        )
    return lines


def study_page(study: Study) -> str:
    """Return the HTML page of a study."""
    text = [f"{len(study.candidates)} placements were tried. Shares of strokes in time are of the quick score, without flight and landing."]
    wide = pareto_figure(study).update_layout(meta=WHOLE_WIDTH)
    return html_page(
        f"Would {study.name} play?",
        [
            Section("Balls", tables=[score_table(study), limits_table(study)], figures=[against_speed(study), speed_figure(study)]),
            Section("Where it should stand", text, tables=[placement_table(study)], figures=[base_figure(study), wide]),
        ],
        lead=arm_summary(study),
    )
