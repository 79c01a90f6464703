"""Write a page of figures of a recorded run: python -m tt_bringup.report BAG [FILE]."""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.colors import qualitative
from plotly.subplots import make_subplots
from tt_core.constants import NET_HEIGHT, NET_X, TABLE_LENGTH, TABLE_WIDTH
from tt_core.errors import TtError
from tt_core.ros.bags import Bag
from tt_eval.page import Section, Table, html_page

from .demo_metrics import DemoMetrics

TOPICS = ("sim/ball", "ball/path", "return/goal", "joint_states", "arm/swing", "diagnostics")
OLD_NAMES = {"arm_trajectory_controller/joint_trajectory": "arm/swing"}  # in bags of earlier versions
PAUSE = 0.05  # s without a true ball, after which the next one is another; states are 2 ms apart
STAGES = ("estimate", "predict", "racket", "arm")


def _seconds(time: Any) -> float:
    return time.sec + time.nanosec * 1e-9


def _xyz(v: Any) -> list[float]:
    return [v.x, v.y, v.z]


def read(path: Path) -> dict[str, list[Any]]:
    """Read the messages that the page shows.

    Returns:
        Messages by the relative names of their topics, TOPICS.

    Raises:
        BagError: The bag cannot be read, or holds several robots.
    """
    found = defaultdict(list)
    with Bag(path) as bag:
        names = {bag.find(name): OLD_NAMES.get(name, name) for name in (*TOPICS, *OLD_NAMES)}
        for message in bag.messages([name for name in names if name]):
            found[names[message.topic]].append(bag.decode(message))
    return found


def balls(messages: Sequence[Any]) -> list[np.ndarray]:
    """Return the true balls one by one, each (n, 4): time s, x, y, z m."""
    rows = np.array([[_seconds(m.header.stamp), *_xyz(m.pose.pose.position)] for m in messages]).reshape(-1, 4)
    return np.split(rows, np.flatnonzero(np.diff(rows[:, 0]) > PAUSE) + 1) if len(rows) else []


def flights(found: dict[str, list[Any]]) -> go.Figure:
    """Draw every ball from the side and from above: true, predicted, asked."""
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.08, subplot_titles=("from the side", "from above"))
    figure.add_shape(type="line", x0=0, x1=TABLE_LENGTH, y0=0, y1=0, line={"color": "#1b5e9b", "width": 4}, row=1, col=1)
    figure.add_shape(type="line", x0=NET_X, x1=NET_X, y0=0, y1=NET_HEIGHT, line={"color": "#444", "width": 2}, row=1, col=1)
    figure.add_shape(type="rect", x0=0, x1=TABLE_LENGTH, y0=0, y1=TABLE_WIDTH, line={"color": "#1b5e9b"}, row=2, col=1)
    figure.add_shape(type="line", x0=NET_X, x1=NET_X, y0=0, y1=TABLE_WIDTH, line={"color": "#444"}, row=2, col=1)
    for i, rows in enumerate(balls(found["sim/ball"])):
        colour = qualitative.Dark24[i % len(qualitative.Dark24)]
        for row, axis in ((1, 3), (2, 2)):
            shared = {"legendgroup": str(i), "mode": "lines", "line": {"color": colour}}
            figure.add_scatter(x=rows[:, 1], y=rows[:, axis], name=f"ball {i + 1}", showlegend=row == 1, row=row, col=1, **shared)
    for path in found["ball/path"]:
        points = np.array([_xyz(p.transforms[0].translation) for p in path.points])
        for row, axis in ((1, 2), (2, 1)):
            dotted = {"mode": "lines", "line": {"color": "#999", "dash": "dot"}, "name": "predicted", "legendgroup": "predicted"}
            first = path is found["ball/path"][0] and row == 1
            figure.add_scatter(x=points[:, 0], y=points[:, axis], showlegend=first, row=row, col=1, **dotted)
    asked = np.array([_xyz(m.points[0].transforms[0].translation) for m in found["return/goal"]]).reshape(-1, 3)
    figure.add_scatter(x=asked[:, 0], y=asked[:, 1], mode="markers", marker={"symbol": "x", "color": "black"}, name="asked", row=2, col=1)
    figure.update_yaxes(title_text="z, m", scaleanchor="x", row=1, col=1, range=[-0.1, 0.7])
    figure.update_yaxes(title_text="y, m", scaleanchor="x", row=2, col=1)
    figure.update_xaxes(title_text="x, m (the robot is left)", range=[-0.8, TABLE_LENGTH + 0.1], row=2, col=1)
    return figure.update_layout(height=760, title="Flights")


def joints(found: dict[str, list[Any]]) -> go.Figure:
    """Draw planned and measured angle of each joint in the last swing, as dissertation Figures 4.11 to 4.14."""
    figure = make_subplots(rows=4, cols=2, shared_xaxes=True)
    swings = found["arm/swing"]
    states = found["joint_states"]
    if not swings or not states:
        return figure.update_layout(title="No swing")
    swing = swings[-1]
    start = _seconds(swing.header.stamp)
    planned_times = np.array([_seconds(p.time_from_start) for p in swing.points])
    times = np.array([_seconds(m.header.stamp) for m in states]) - start
    shown = (times > -0.1) & (times < planned_times[-1] + 0.1)
    measured = np.array([m.position for m, show in zip(states, shown, strict=True) if show]).reshape(-1, len(swing.joint_names))
    planned = np.array([p.positions for p in swing.points])
    for i, name in enumerate(swing.joint_names):
        place = {"row": i // 2 + 1, "col": i % 2 + 1}
        figure.add_scatter(x=planned_times, y=planned[:, i], name="planned", line={"color": "#1b5e9b"}, showlegend=i == 0, **place)
        dots = {"mode": "markers", "marker": {"color": "#c0392b", "size": 3}}
        figure.add_scatter(x=times[shown], y=measured[:, i], name="measured", showlegend=i == 0, **dots, **place)
        figure.update_yaxes(title_text=f"{name}, rad", **place)
    return figure.update_layout(height=760, title="The last swing, s after its start")


def latencies(found: dict[str, list[Any]]) -> go.Figure:
    """Draw the latency of each stage, from the middle of the exposure of the last frame."""
    of: dict[str, list[float]] = {stage: [] for stage in STAGES}
    for message in found["diagnostics"]:
        for status in message.status:
            values = {v.key: v.value for v in status.values}
            if status.name in of and "latency_ms" in values and "strike" not in values:
                of[status.name].append(float(values["latency_ms"]))
    figure = go.Figure([go.Box(y=values, name=stage, boxpoints="all") for stage, values in of.items()])
    return figure.update_layout(title="Latency since the last frame", yaxis_title="ms", showlegend=False, height=420)


def _table(scores: Sequence[DemoMetrics]) -> Table:
    """Return a column for each ball, a row for each metric."""

    def cell(value: object) -> str:
        if isinstance(value, float):
            return f"{value:.4g}"
        if isinstance(value, list):
            return ", ".join(f"{v:.4g}" for v in value)
        return "" if value is None else str(value)

    columns = [score.as_dict() for score in scores]
    head = ["", *(f"ball {i}" for i in range(1, len(scores) + 1))]
    return Table(head, [[key, *(cell(column[key]) for column in columns)] for key in columns[0]])


def page(bag: Path, scores: Sequence[DemoMetrics] = ()) -> str:
    """Return the page of a run, which needs no network.

    Args:
        bag: The recording.
        scores: Metrics of its balls, if there are any.

    Raises:
        BagError: The bag cannot be read, or holds several robots.
    """
    found = read(bag)
    return html_page(
        str(bag), [Section(tables=[_table(scores)] if scores else (), figures=[flights(found), latencies(found), joints(found)])]
    )


def main() -> None:
    """Write the page."""
    if len(sys.argv) not in (2, 3):
        raise SystemExit(__doc__)
    bag = Path(sys.argv[1])
    out = Path(sys.argv[2]) if len(sys.argv) == 3 else bag.parent / "report.html"
    try:
        out.write_text(page(bag))
    except (TtError, OSError) as error:
        raise SystemExit(f"report: {error}") from error
    print(out)


if __name__ == "__main__":
    main()
