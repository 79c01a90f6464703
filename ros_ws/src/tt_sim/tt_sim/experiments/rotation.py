"""The rotation machine: a ball that turns in place about the two printed axes, 1,500 to 3,000 rpm (Figures 2.14 and 2.15)."""

from __future__ import annotations

import time

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots
from rich.console import Console
from rich.table import Table
from tt_core.constants import RPM
from tt_vision.rig import VIEW_CENTRE
from tt_vision.spin import estimate_spin

from ..render import Lamp, Lamps, Texture
from ..rotation import AXES, SPEEDS
from ..trials import Conditions, film

METHODS = {"correlation": "Method 1", "liu": "Method 2", "registration": "registration"}
LAMP = Lamps((Lamp((2.45, 0.33, 0.60), 0.25),), ambient=0.12)  # one, 0.5 m from the ball, near the lines of sight
CLOSE = 0.97  # inner product of the axes that counts as right, 14 deg


def run(runs: int) -> list[go.Figure]:
    """Prints how often speed and axis are right; returns Figures 2.14 and 2.15."""
    rng = np.random.default_rng(0)
    rows = []  # axis, speed, method, estimated speed, inner product, vector error, ms
    for a, axis in enumerate(AXES):
        for speed in SPEEDS:
            for trial in range(runs):
                spin = speed * RPM * np.array(axis) / np.linalg.norm(axis)
                burst = film(np.array(VIEW_CENTRE), np.zeros(3), spin, Texture.drawn(trial % 20), Conditions(lamps=LAMP), rng)
                for method in METHODS:
                    start = time.perf_counter()
                    got = estimate_spin(burst.images, burst.times, burst.cameras, method=method).spin
                    took = 1e3 * (time.perf_counter() - start)
                    along = got @ spin / max(float(np.linalg.norm(got) * np.linalg.norm(spin)), 1e-12)
                    rows.append((a, speed, method, np.linalg.norm(got) / RPM, along, np.linalg.norm(got - spin) / RPM, took))
    table = Table("method", "axis", "speed within 200 rpm", "axis within 15 deg", "vector error rpm, median", "time ms, median")
    for method, name in METHODS.items():
        for a in (0, 1):
            mine = np.array([(s, *row) for b, s, m, *row in rows if m == method and b == a])
            right, aligned = (np.abs(mine[:, 1] - mine[:, 0]) < 200).mean(), (mine[:, 2] > CLOSE).mean()
            table.add_row(
                name, str(a + 1), f"{right:.0%}", f"{aligned:.0%}", f"{np.median(mine[:, 3]):.1f}", f"{np.median(mine[:, 4]):.0f}"
            )
    table.add_row("dissertation, Method 2", "both", "89%", "75%", "", "30 to 65")
    Console(width=120).print(table)
    return [_figure(rows, 3, "Figure 2.14: estimated speed, rpm"), _figure(rows, 4, "Figure 2.15: inner product with the true axis")]


def _figure(rows: list[tuple], column: int, title: str) -> go.Figure:
    figure = make_subplots(1, 2, subplot_titles=["axis 1", "axis 2"])
    for a in (0, 1):
        for (method, name), symbol, shift in zip(
            METHODS.items(), ("circle-open", "cross-thin-open", "x-thin-open"), (-30, 0, 30), strict=True
        ):
            mine = [row for row in rows if row[0] == a and row[2] == method]
            x, y = [row[1] + shift for row in mine], [row[column] for row in mine]
            figure.add_scatter(x=x, y=y, mode="markers", name=name, marker_symbol=symbol, row=1, col=a + 1, showlegend=a == 0)
    return figure.update_layout(title=title, height=420).update_xaxes(title="true speed, rpm")
