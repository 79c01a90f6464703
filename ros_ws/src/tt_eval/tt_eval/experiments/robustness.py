"""Robustness of the measurement of the ball: spin about any axis, 0 to 9,000 rpm, and conditions that are made worse one by one."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
from rich.console import Console
from rich.table import Table
from tt_core.constants import RPM
from tt_sim.render import Lamps, Noise
from tt_vision.measure import measure_burst

from ..page import BLUE, WHOLE_WIDTH
from ..progress import tracked
from ..synthetic_bursts import BurstConditions, bursts

BASE = BurstConditions()
FLICKER = Lamps(tuple(replace(lamp, flicker=0.15) for lamp in Lamps().lamps))
DEGREE = math.pi / 180.0
MESSY = BurstConditions(gloss=0.1, lamps=FLICKER, noise=Noise(lens_blur=1.0, gamma=1.2), pose_angle=0.02 * DEGREE, pose_shift=0.3e-3)
SWEEPS: dict[str, BurstConditions] = {
    "as it is": BASE,
    **{f"{low} to {low + 3000} rpm": replace(BASE, slowest=low, fastest=low + 3000) for low in (0, 3000, 6000)},
    "one lamp": replace(BASE, lamps=Lamps(Lamps().lamps[:1])),
    "flicker 15 %": replace(BASE, lamps=FLICKER),
    "defocus, 1.2 pixels": replace(BASE, noise=Noise(lens_blur=1.2)),
    "gamma 1.5": replace(BASE, noise=Noise(gamma=1.5)),
    "gloss 0.15": replace(BASE, gloss=0.15),
    "cameras off by 0.02 deg, 0.3 mm": replace(BASE, pose_angle=0.02 * DEGREE, pose_shift=0.3e-3),
    "cameras off by 0.05 deg, 1 mm": replace(BASE, pose_angle=0.05 * DEGREE, pose_shift=1e-3),
    "all of these a little": MESSY,
    **{f"exposure {us} us": replace(BASE, exposure=us * 1e-6) for us in (50, 400, 900)},
    **{f"K = {k}": replace(BASE, frames=k) for k in (3, 4, 8)},
    **{f"{rate:.0f} Hz": replace(BASE, frame_rate=rate, frames=max(3, round(6 * rate / 900))) for rate in (450.0, 600.0, 1200.0)},
    **{f"{blobs} marks": replace(BASE, blobs=blobs) for blobs in (4, 8, 24)},
    "one camera": BASE,
    "10 bits": replace(BASE, noise=Noise(bits=10)),
}


def run(runs: int) -> list[go.Figure]:
    """Measure `runs` rendered balls under each condition of SWEEPS, and print a table of the errors of spin, position and velocity.

    Returns:
        A list of one figure: the errors of the spin under each condition.
    """
    table = Table("condition", "spin rpm, median", "95 %", "worst", "over 300", "refused", "position mm, 95 %", "velocity m/s, 95 %")
    figure = go.Figure()
    for name, conditions in tracked("conditions", len(SWEEPS), SWEEPS.items()):
        misses, refused = [], 0
        for burst in bursts(runs, conditions):
            ball = measure_burst(burst.left_burst if name == "one camera" else burst.burst).ball
            if ball is None:
                refused += 1
                continue
            miss = ball.vector - burst.ball.vector
            misses.append((np.linalg.norm(miss[:3]) * 1e3, np.linalg.norm(miss[3:6]), np.linalg.norm(miss[6:]) / RPM))
        rows = np.array(misses).reshape(-1, 3)
        at: Callable[[int, float], str] = lambda k, q: f"{np.percentile(rows[:, k], q):.3g}" if len(rows) else "-"  # noqa: E731, B023
        wrong = int((rows[:, 2] > 300.0).sum())
        table.add_row(name, at(2, 50), at(2, 95), at(2, 100), str(wrong), f"{refused} of {runs}", at(0, 95), at(1, 95))
        figure.add_box(y=rows[:, 2], name=name, boxpoints="all", showlegend=False, marker_color=BLUE)
    Console(width=150).print(table)
    figure.update_layout(title=f"Error of the spin, {runs} bursts each", height=600, meta=WHOLE_WIDTH)
    return [figure.update_yaxes(type="log", title_text="rpm")]
