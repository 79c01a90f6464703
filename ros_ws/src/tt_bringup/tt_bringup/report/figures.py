"""Plotly figures of a run and of its balls."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from tt_core.constants import NET_HEIGHT, NET_X, TABLE_LENGTH, TABLE_WIDTH
from tt_core.states import Array
from tt_eval.page import BLUE, COLOURS, GREEN, GREY, ORANGE

from .arm_pose import ArmPose
from .run_record import STAGE_NAMES, BallRecord, RunRecord

SWING_MARGIN = 0.15  # s that are shown before and after a swing
MOST_BARS = 60  # most balls whose latencies are drawn; more bars would be too thin to read
MOST_LINE_POINTS = 400  # a line has about so many points at most


def landings(balls: Sequence[BallRecord]) -> go.Figure:
    """Draw, seen from above, where the returns were asked to land and where they landed."""
    figure = go.Figure()
    _table_from_above(figure)
    metrics = [ball.metrics for ball in balls if ball.metrics is not None]
    asked = np.array([m.landing_asked for m in metrics]).reshape(-1, 2)
    reached = [(ball.number, ball.metrics.landing_reached) for ball in balls if ball.metrics and ball.metrics.landing_reached]
    places = np.array([place for _, place in reached]).reshape(-1, 2)
    names = [f"ball {number}" for number, _ in reached]
    figure.add_scatter(
        x=places[:, 0], y=places[:, 1], mode="markers", name="reached", text=names, marker={"symbol": "x", "size": 7, "color": ORANGE}
    )
    ring = {"symbol": "circle-open", "size": 16, "color": GREEN, "line": {"width": 3}}  # last, so that many landings do not cover it
    figure.add_scatter(x=asked[:, 0], y=asked[:, 1], mode="markers", name="asked", marker=ring)
    figure.update_xaxes(title_text="x, m (the robot is left)", range=[-0.1, TABLE_LENGTH + 0.1])
    figure.update_yaxes(title_text="y, m", scaleanchor="x", range=[-0.1, TABLE_WIDTH + 0.1])
    return figure.update_layout(title="Where the returns landed", height=400)


def latencies(balls: Sequence[BallRecord]) -> go.Figure:
    """Draw how long each stage from the last camera image to the first joint command took, as a stacked bar for each ball."""
    shown = [ball for ball in balls if ball.latencies][:MOST_BARS]
    figure = go.Figure()
    until = np.array([[ball.latencies.get(event, np.nan) for ball in shown] for event in STAGE_NAMES])
    until = np.fmin.accumulate(until[::-1])[::-1]  # the status of a stage may come after the next stage has finished
    until = np.where(np.isfinite(until), until, 0.0)
    until = np.maximum.accumulate(until)
    for colour, name, spent in zip(COLOURS, STAGE_NAMES.values(), np.diff(until, axis=0, prepend=0.0), strict=False):
        figure.add_bar(y=[f"ball {ball.number}" for ball in shown], x=spent, name=name, orientation="h", marker_color=colour)
    figure.update_xaxes(title_text="ms since the last image").update_yaxes(autorange="reversed")
    title = "From the last image to the first joint command"
    if len(shown) < len(balls):
        title += f" (the first {len(shown)} balls that have them)"
    height = 140 + 26 * len(shown) if len(shown) > 1 else 190
    return figure.update_layout(title=title, barmode="stack", legend_traceorder="normal", height=height)


def from_the_side(ball: BallRecord) -> go.Figure:
    """Draw the flight of a ball from the side: the true and the predicted path, and the landing that was asked for."""
    figure = go.Figure()
    figure.add_shape(type="line", x0=0, x1=TABLE_LENGTH, y0=0, y1=0, line={"color": BLUE, "width": 4})
    figure.add_shape(type="line", x0=NET_X, x1=NET_X, y0=0, y1=NET_HEIGHT, line={"color": GREY, "width": 2})
    _flight(figure, ball, 2)
    if ball.goal is not None:
        figure.add_scatter(x=[ball.goal.landing[0]], y=[0.0], mode="markers", name="asked", marker=_ring())
    figure.update_xaxes(title_text="x, m (the robot is left)").update_yaxes(title_text="z, m", scaleanchor="x", range=[-0.15, 0.8])
    return figure.update_layout(title="From the side", height=330)


def from_above(ball: BallRecord) -> go.Figure:
    """Draw the flight of a ball from above: the true and the predicted path, and the landing that was asked for."""
    figure = go.Figure()
    _table_from_above(figure)
    _flight(figure, ball, 1)
    if ball.goal is not None:
        figure.add_scatter(x=[ball.goal.landing[0]], y=[ball.goal.landing[1]], mode="markers", name="asked", marker=_ring())
    figure.update_xaxes(title_text="x, m (the robot is left)").update_yaxes(title_text="y, m", scaleanchor="x")
    return figure.update_layout(title="From above", height=330)


def prediction_error(ball: BallRecord) -> go.Figure | None:
    """Draw the distance between predicted and true ball over the time since the last image.

    Returns:
        The figure, up to the contact with the racket; None if the prediction or the truth was not recorded.
    """
    if ball.path is None or not len(ball.truth):
        return None
    struck = ball.swing.strike if ball.swing is not None else np.inf
    times = ball.truth[:, 0]
    shown = (times >= ball.path.times[0]) & (times <= min(ball.path.times[-1], struck))
    if not shown.any():
        return None
    off = 1e3 * np.linalg.norm(ball.path.rows(times[shown])[:, :3] - ball.truth[shown, 1:], axis=1)
    figure = go.Figure().add_scatter(x=1e3 * (times[shown] - ball.path.times[0]), y=off, line={"color": BLUE}, name="prediction")
    figure.update_xaxes(title_text="ms since the last image").update_yaxes(title_text="mm", rangemode="tozero")
    return figure.update_layout(title="Predicted place minus true place", height=330)


def joint_figures(ball: BallRecord, run: RunRecord, arm: ArmPose | None) -> list[go.Figure]:
    """Draw the joints during a swing: speeds relative to their limits, positions within their ranges, and deviation from the plan.

    Args:
        ball: Record of the ball.
        run: Record of the run, which has the names of the joints.
        arm: The arm, which has the limits; None to leave out the figures that need them.

    Returns:
        The figures; an empty list if there was no swing or no joint states were recorded.
    """
    swing = ball.swing
    if swing is None or not len(ball.joints):
        return []
    rows = ball.joints[(ball.joints[:, 0] > swing.times[0] - SWING_MARGIN) & (ball.joints[:, 0] < swing.times[-1] + SWING_MARGIN)]
    if not len(rows):
        return []
    count = len(run.joint_names)
    since = rows[:, 0] - swing.strike
    q, speed = rows[:, 1 : 1 + count], rows[:, 1 + count :]
    planned = np.column_stack([np.interp(rows[:, 0], swing.times, swing.q[:, k]) for k in range(count)])
    figures = []
    if arm is not None:
        shares = 100.0 * speed / arm.speed_limits
        figures.append(_joints(run, since, shares, "Joint speeds, share of their limits", "%", limits=(-100.0, 100.0)))
        low, high = arm.position_limits.T
        if np.isfinite(low).all() and np.isfinite(high).all():
            ranges = 100.0 * (q - low) / (high - low)
            figures.append(_joints(run, since, ranges, "Joint positions within their ranges", "%", limits=(0.0, 100.0)))
    error = 1e3 * (q - planned)
    inside = (rows[:, 0] >= swing.times[0]) & (rows[:, 0] <= swing.times[-1])
    figures.append(_joints(run, since[inside], error[inside], "Joint positions, measured minus planned", "mrad or mm"))
    return figures


def _joints(run: RunRecord, since: Array, values: Array, title: str, unit: str, limits: tuple[float, float] | None = None) -> go.Figure:
    """Draw a line for each joint over the time since the strike.

    Args:
        run: Record of the run, which has the names of the joints.
        since: (n,) time since the strike, s.
        values: (n, joints) what is drawn.
        title: Title of the figure.
        unit: Unit of the values.
        limits: Lowest and highest value that is allowed; None to draw no limits.
    """
    figure, few = go.Figure(), slice(None, None, max(1, len(since) // MOST_LINE_POINTS))
    for k, name in enumerate(run.joint_names):
        figure.add_scatter(x=since[few], y=values[few, k], name=name, line={"color": COLOURS[k % len(COLOURS)], "width": 1.6})
    figure.add_vline(x=0.0, line={"color": GREY, "width": 1, "dash": "dot"})
    for limit in limits or ():
        figure.add_hline(y=limit, line={"color": ORANGE, "width": 2, "dash": "dash"})
    figure.update_xaxes(title_text="s from the strike").update_yaxes(title_text=unit)
    return figure.update_layout(title=title, height=360)


def _flight(figure: go.Figure, ball: BallRecord, axis: int) -> None:
    """Add the true and the predicted path of a ball to a figure, over x. axis: 1 to draw y, 2 to draw z."""
    if len(ball.truth):
        rows = ball.truth[:: max(1, len(ball.truth) // MOST_LINE_POINTS)]
        figure.add_scatter(x=rows[:, 1], y=rows[:, 1 + axis], name="true", line={"color": BLUE, "width": 3})
    if ball.path is not None:
        places = ball.path.positions
        figure.add_scatter(x=places[:, 0], y=places[:, axis], name="predicted", line={"color": ORANGE, "dash": "dot"})


def _ring() -> dict[str, object]:
    return {"symbol": "circle-open", "size": 14, "color": GREEN, "line": {"width": 3}}


def _table_from_above(figure: go.Figure) -> None:
    figure.add_shape(type="rect", x0=0, x1=TABLE_LENGTH, y0=0, y1=TABLE_WIDTH, line={"color": BLUE})
    figure.add_shape(type="line", x0=NET_X, x1=NET_X, y0=0, y1=TABLE_WIDTH, line={"color": GREY})
