"""The catapult experiment of dissertation Section 2.5.2: Tables 2.1 to 2.3 and Figures 2.17 to 2.20.

Velocity and spin of launched balls are measured from bursts, sets of six rendered image pairs, by the dissertation's Method 2 and by this
project's method.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator

import numpy as np
import plotly.graph_objects as go
from rich.console import Console
from rich.table import Table
from scipy.spatial import cKDTree
from tt_core.arrays import SPIN, VELOCITY, Array
from tt_core.constants import RPM
from tt_core.so3 import rotation_matrix
from tt_sim.render import Texture
from tt_sim.world.launcher import LauncherParams, launch
from tt_vision.capture.burst import Burst
from tt_vision.detection.ball_detection import detect_balls
from tt_vision.measure import measure_burst
from tt_vision.rig import VIEW_CENTRE
from tt_vision.spin.dissertation import centres_by_four_points, inscribed_square, method_2, velocity_by_least_squares

from ..progress import tracked
from ..synthetic_bursts import BurstConditions, SyntheticBurst, render_burst

SHOTS = (("top", 3), ("top", 4), ("top", 4), ("top", 5), ("back", 4), ("left", 4), ("right", 4))
PRINTED = {  # Tables 2.1 to 2.3, in the order of the shots; topspin is printed with the sign of w_y flipped
    0: "5.57 m/s, 2737 rpm, 32 ms, IN 8",
    1: "6.37 m/s, 3188 rpm, 47 ms, IN 10",
    2: "6.25 m/s, 3253 rpm, 47 ms, IN 10",
    3: "7.29 m/s, 3630 rpm, 47 ms, IN 12",
}
PICTURES = 6  # pictures of one burst
PICTURE_MARGIN = 1.3  # half squares around the balls that the pictures show
CAMERA = 1  # index of the camera of the pictures, Camera 2 in the dissertation


def rendered_shots(runs: int) -> Iterator[tuple[int, int, SyntheticBurst]]:
    """Render the balls of the experiment.

    Args:
        runs: Trials of each shot.

    Yields:
        Number of the shot, number of the trial, and the images with the true state.
    """
    rng = np.random.default_rng(0)
    for n, (kind, scale) in enumerate(SHOTS):
        for trial in range(runs):
            shot, _ = launch(kind, scale, LauncherParams(), rng)
            yield (
                n,
                trial,
                render_burst(np.array(VIEW_CENTRE), shot.velocity, shot.spin, Texture.drawn((n + trial) % 20), BurstConditions(), rng),
            )


def run(runs: int) -> list[go.Figure]:
    """Run the catapult experiment on `runs` trials of each shot, and print a table.

    The table has speed, spin, time and iterations of the first trial, and the median errors of the trials that were measured.

    Returns:
        Figures 2.17 to 2.20.
    """
    heads = (
        "shot",
        "true: m/s, rpm",
        "as printed: m/s, rpm, E, ms, IN",
        "off, median: m/s, rpm",
        "ours: m/s, rpm, ms",
        "ours off, median: m/s, rpm",
    )
    table = Table(*heads, "printed")
    traces: list[tuple[str, list[tuple[float, Array]]]] = []
    pictures: list[go.Figure] = []
    for n, filmed in itertools.groupby(tracked("bursts", len(SHOTS) * runs, rendered_shots(runs)), key=lambda shot: shot[0]):
        (kind, scale), misses = SHOTS[n], []
        for _, trial, burst in filmed:
            detected = detect_balls(burst.burst)
            trace: list[tuple[float, Array]] = []
            start = time.perf_counter()
            spin, error, count = method_2(detected, trace=trace)
            velocity = velocity_by_least_squares(centres_by_four_points(detected).positions, burst.times)
            middle = time.perf_counter()
            ours = measure_burst(burst.burst).ball
            end = time.perf_counter()
            printed = (np.linalg.norm(velocity - burst.ball.velocity), np.linalg.norm(spin - burst.ball.spin) / RPM)
            if ours is not None:
                miss = ours.vector - burst.ball.vector
                misses.append((*printed, np.linalg.norm(miss[VELOCITY]), np.linalg.norm(miss[SPIN]) / RPM))
            if trial == 0:
                true, theirs, found = (
                    f"{np.linalg.norm(burst.ball.velocity):.2f}, {np.linalg.norm(burst.ball.spin) / RPM:.0f}",
                    f"{np.linalg.norm(velocity):.2f}, {np.linalg.norm(spin) / RPM:.0f}, {error:.0f}, {1e3 * (middle - start):.0f}, {count}",
                    "refused"
                    if ours is None
                    else f"{np.linalg.norm(ours.velocity):.2f}, {np.linalg.norm(ours.spin) / RPM:.0f}, {1e3 * (end - middle):.0f}",
                )
                traces.append((f"{kind} {scale}, shot {n + 1}", trace))
                if (kind, scale) == ("top", 4):
                    pictures += _pictures(detected, spin, f"Figure 2.{19 + len(pictures) // PICTURES}: top 4, shot {n + 1}")
        slow, off, speed, spin_off = np.median(misses, axis=0) if misses else (np.nan,) * 4
        ours_off = f"{speed:.4f}, {spin_off:.1f}"
        table.add_row(f"{kind} {scale}", true, theirs, f"{slow:.3f}, {off:.0f}", found, ours_off, PRINTED.get(n, ""))
    Console(width=170).print(table)
    return [*_convergence(traces), *pictures]


def _convergence(traces: list[tuple[str, list[tuple[float, Array]]]]) -> list[go.Figure]:
    objective, speed = go.Figure(), go.Figure()
    for name, trace in traces:
        steps = list(range(1, len(trace) + 1))
        objective.add_scatter(x=steps, y=[error for error, _ in trace], name=name)
        speed.add_scatter(x=steps, y=[np.linalg.norm(spin) / RPM for _, spin in trace], name=name)
    objective.update_layout(title="Figure 2.17: objective E by iteration of Method 2", xaxis_title="iteration", yaxis_title="E")
    speed.update_layout(title="Figure 2.18: estimated speed by iteration of Method 2", xaxis_title="iteration", yaxis_title="rpm")
    return [objective, speed]


def _pictures(burst: Burst, spin: Array, title: str) -> list[go.Figure]:
    """Return the PICTURES pictures of one burst.

    (a) a frame, (b) its square, (c) the next frame's square as estimated from it, (d) the next frame, (e) its square, (f) the residual.
    """
    camera, images = burst.cameras[CAMERA], burst.images[CAMERA].astype(np.float32)
    pixels, positions = centres_by_four_points(burst)
    centres = positions @ camera.rotation.T + camera.translation
    half = 0.5 * np.sqrt(2.0) * camera.focal_pixels * 0.02 / centres[:, 2].mean()
    arms, greys = inscribed_square(images, pixels[CAMERA], centres, camera.vector, half)
    known = ~np.isnan(arms[0, :, 0])
    turned = arms[0, known] @ rotation_matrix(camera.rotation @ spin * (burst.times[1] - burst.times[0])).T + centres[1]
    at = camera.project((turned - camera.translation) @ camera.rotation)
    v, u = np.mgrid[: camera.height, : camera.width]
    _, which = cKDTree(at).query(np.stack([u, v], axis=-1).reshape(-1, 2), distance_upper_bound=1.0)  # nearest point, (2.27), (2.31)
    estimated = np.append(greys[0, known], np.nan)[which].reshape(u.shape)
    inside = [np.maximum(np.abs(u - x), np.abs(v - y)) <= half for x, y in pixels[CAMERA, :2]]
    residual = np.where(inside[1], images[1] - estimated, np.nan)
    panels = (images[0], np.where(inside[0], images[0], np.nan), estimated, images[1], np.where(inside[1], images[1], np.nan), residual)
    names = ("(a) frame k", "(b) its square", "(c) estimated k + 1", "(d) frame k + 1", "(e) its square", "(f) residual")
    low, high = pixels[CAMERA, :2].min(axis=0) - PICTURE_MARGIN * half, pixels[CAMERA, :2].max(axis=0) + PICTURE_MARGIN * half
    (left, top), (right, bottom) = np.maximum(low, 0).astype(int), high.astype(int)
    figures = []
    for n, (name, panel) in enumerate(zip(names, panels, strict=True)):
        scale = {"zmin": -100, "zmax": 100, "colorscale": "RdBu"} if n == 5 else {"zmin": 0, "zmax": 255, "colorscale": "Greys_r"}
        figure = go.Figure().add_heatmap(z=panel[top:bottom, left:right].astype(np.float32), showscale=False, **scale)
        figure.update_xaxes(visible=False, constrain="domain")
        figure.update_yaxes(visible=False, autorange="reversed", scaleanchor="x", constrain="domain")
        figures.append(figure.update_layout(title=f"{title}, {name}", height=300))
    return figures
