"""The rotation machine: a ball that rotates in place about the two printed axes, 1,500 to 3,000 rpm (Figures 2.14 and 2.15).

The text of the dissertation does not say in which frame the axes are given. In `table` the first axis points along the lines of sight of
cameras beside the table, about which Method 1 cannot see a rotation. In the frame of Camera 2, x to the right and y down, both axes lie
across the line of sight. So both frames are shown. Method 1 then finds 0.4 to 0.9 of the speed: it takes the shift of a square for that of
its middle, but marks off the middle move less.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import plotly.graph_objects as go
from rich.console import Console
from rich.table import Table
from tt_core.constants import RPM
from tt_core.states import Array
from tt_sim.render import Lamp, Lamps, Texture
from tt_sim.world.rotation_machine import AXES, SPEEDS
from tt_vision.rig import VIEW_CENTRE, high_speed_pair
from tt_vision.spin import estimate_spin

from ..page import COLOURS, GREY
from ..progress import tracked
from ..synthetic_bursts import BurstConditions, SyntheticBurst, render_burst

AXIS_FRAMES = {"table": np.eye(3), "camera 2": high_speed_pair()[1].rotation.T}  # to `table`
METHOD_NAMES = {"correlation": "Method 1", "liu": "Method 2", "registration": "registration"}
SINGLE_LAMP = Lamps((Lamp((2.45, 0.33, 0.60), 0.25),), ambient=0.12)  # one lamp, 0.5 m from the ball, near the lines of sight
ALIGNED_COSINE = 0.97  # least inner product of the estimated and the true axis that counts as right, 14 deg
RIGHT = 200.0  # rpm, largest error of the speed that counts as right


def turning(runs: int) -> Iterator[tuple[str, int, int, Array, SyntheticBurst]]:
    """Render the balls of the experiment.

    Args:
        runs: Trials of each speed, axis and frame.

    Yields:
        Name of the frame, number of the axis, speed (rpm), true spin (3,) in rad/s, and the images of each trial.
    """
    rng = np.random.default_rng(0)
    for frame, rotation in AXIS_FRAMES.items():
        for a, axis in enumerate(AXES):
            for speed in SPEEDS:
                for trial in range(runs):
                    spin = speed * RPM * rotation @ np.array(axis) / np.linalg.norm(axis)
                    still = render_burst(
                        np.array(VIEW_CENTRE), np.zeros(3), spin, Texture.drawn(trial % 20), BurstConditions(lamps=SINGLE_LAMP), rng
                    )
                    yield frame, a, speed, spin, still


def along(got: Array, spin: Array) -> float:
    """Return the inner product of the axes of two spins; 0 if one of them is zero.

    Args:
        got: (3,) rad/s, estimated spin.
        spin: (3,) rad/s, true spin.
    """
    return float(got @ spin / max(float(np.linalg.norm(got) * np.linalg.norm(spin)), 1e-12))


class SpinComparison(NamedTuple):
    """Comparison of an estimated spin with the true one, for one burst and one method.

    Attributes:
        frame: Name of the frame in which the axis of rotation is given.
        axis: Number of the axis.
        method: Method of `estimate_spin`.
        speed: rpm, true speed of rotation.
        estimated: rpm, estimated speed.
        along: Inner product of the estimated and the true axis.
        error: rpm, length of the difference of the spins.
        took: ms, computing time.
    """

    frame: str
    axis: int
    method: str
    speed: float
    estimated: float
    along: float
    error: float
    took: float


def run(runs: int) -> list[go.Figure]:
    """Measure each spin of the rotation machine `runs` times with each method, and print how often speed and axis are right.

    Returns:
        Figures 2.14 and 2.15.
    """
    results = list[SpinComparison]()
    count = len(AXIS_FRAMES) * len(AXES) * len(SPEEDS) * runs
    for frame, a, speed, spin, burst in tracked("bursts", count, turning(runs)):
        for method in METHOD_NAMES:
            start = time.perf_counter()
            got = estimate_spin(burst.images, burst.times, burst.cameras, method=method).spin
            took = 1e3 * (time.perf_counter() - start)
            estimated, error = float(np.linalg.norm(got)) / RPM, float(np.linalg.norm(got - spin)) / RPM
            results.append(SpinComparison(frame, a, method, speed, estimated, along(got, spin), error, took))
    heads = ("method", "axes in", "axis", "speed within 200 rpm", "axis within 15 deg", "vector error rpm, median", "time ms, median")
    table = Table(*heads)
    for method, name in METHOD_NAMES.items():
        for frame in AXIS_FRAMES:
            for a in (0, 1):
                mine = [one for one in results if (one.frame, one.axis, one.method) == (frame, a, method)]
                right = np.mean([abs(one.estimated - one.speed) < RIGHT for one in mine])
                aligned = np.mean([one.along > ALIGNED_COSINE for one in mine])
                error, took = np.median([one.error for one in mine]), np.median([one.took for one in mine])
                cells = (f"{right:.0%}", f"{aligned:.0%}", f"{error:.1f}", f"{took:.0f}")
                table.add_row(name, frame, str(a + 1), *cells)
    table.add_row("dissertation, Method 2", "?", "both", "89%", "75%", "", "30 to 65")
    Console(width=130).print(table)
    figures = []
    for frame in AXIS_FRAMES:
        for a in (0, 1):
            where = f"axis {a + 1}, axes in {frame}"
            about_axis = [one for one in results if (one.frame, one.axis) == (frame, a)]
            speeds = _figure(about_axis, "estimated", f"Figure 2.14: estimated speed, {where}", "rpm")
            speeds.add_scatter(x=SPEEDS, y=SPEEDS, mode="lines", name="true", line={"color": GREY, "dash": "dot"})
            along_axis = _figure(about_axis, "along", f"Figure 2.15: agreement of the axis, {where}", "inner product")
            along_axis.add_hline(y=1.0, line={"color": GREY, "dash": "dot"})
            figures += [speeds, along_axis]
    return figures


def _figure(results: list[SpinComparison], name: str, title: str, unit: str) -> go.Figure:
    """Draw the attribute `name` of the results of one axis against the true speed, a mark for each burst and a colour for each method."""
    figure = go.Figure()
    marks = zip(METHOD_NAMES.items(), ("circle-open", "cross-thin-open", "x-thin-open"), (-30, 0, 30), COLOURS, strict=False)
    for (method, label), symbol, shift, colour in marks:
        mine = [one for one in results if one.method == method]
        x, y = [one.speed + shift for one in mine], [getattr(one, name) for one in mine]
        figure.add_scatter(x=x, y=y, mode="markers", name=label, marker={"symbol": symbol, "color": colour})
    figure.update_xaxes(title_text="true speed, rpm").update_yaxes(title_text=unit)
    return figure.update_layout(title=title, height=380)
