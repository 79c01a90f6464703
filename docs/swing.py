"""The last swing of a recording, as dissertation Figures 4.11 to 4.14: python docs/swing.py BAG FILE.html, in the project's environment.

BAG may also be a kind and a scale, as in "top 3": then that ball is played without ROS, its strokes made by the arm with lag.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from tt_arm.control import ArmControl
from tt_arm.joints import Joints
from tt_arm.model import ArmModel
from tt_bringup.report.run_record import RunRecord
from tt_core.errors import TtError
from tt_eval.arm_loop import arm_ticks
from tt_eval.arm_trial import STROKES_AT, TRIAL_TICK, launched_ball_strokes
from tt_eval.page import BLUE, GREY, ORANGE, Section, html_page, write_page
from tt_sim.world.plant import Plant, PlantParams

AROUND = 0.5  # s, shown before and after the strike


def recorded(bag: Path) -> tuple[np.ndarray, np.ndarray, float]:
    """Reference and measured rows (n, 15) of time s, q rad, qdot rad/s, and the time (s) of the strike, the fastest point of the swing."""
    balls = [ball for ball in RunRecord.read(bag).balls if ball.swing is not None and len(ball.joints)]
    if not balls:
        raise SystemExit(f"{bag} holds no arm/swing with joint_states: a recording of a swing is needed")
    swing = balls[-1].swing
    return np.column_stack([swing.times, swing.q, swing.qdot]), balls[-1].joints, swing.strike


def played(kind: str, scale: int) -> tuple[np.ndarray, np.ndarray, float]:
    """The same of a ball of seed 0."""
    model = ArmModel.pa10()
    control, plant, start, choice, rows = ArmControl(model), Plant(model, PlantParams()), Joints(0.0, model.waiting, np.zeros(7)), None, []
    control.enable(True)
    for joints, _ in arm_ticks(control, plant, start, TRIAL_TICK, np.random.default_rng(0)):
        if joints.time >= 2.5:
            break
        if choice is None and joints.time >= STROKES_AT:
            choice = control.take(launched_ball_strokes(kind, scale, 0))
            if choice.swing is None:
                raise SystemExit(f"{kind} {scale}: {'; '.join(map(str, choice.reasons))}")
        rows.append([joints.time, *joints.q, *joints.qdot])
    times = np.array([row[0] for row in rows])
    reference = np.array([[t, *np.hstack(choice.swing.sample(t))] for t in times])
    return reference, np.array(rows), choice.swing.strike_time


def figures(reference: np.ndarray, measured: np.ndarray, strike: float) -> list[go.Figure]:
    """q, its error and qdot of each joint over the time from the strike."""
    made = []
    shown = [rows[np.abs(rows[:, 0] - strike) < AROUND] for rows in (reference, measured)]
    for i, name in enumerate(ArmModel.pa10().names):
        for first, what, unit in ((1, "angle", "rad"), (8, "speed", "rad/s")):
            figure = go.Figure()
            for rows, label, colour, dash in zip(shown, ("reference", "measured"), (BLUE, ORANGE), ("solid", "dot"), strict=True):
                figure.add_scatter(x=rows[:, 0] - strike, y=rows[:, first + i], name=label, line={"color": colour, "dash": dash})
            made.append(_over_time(figure, f"{name}: {what}", unit))
        times = shown[1][:, 0]
        error = 1e3 * (shown[1][:, 1 + i] - np.interp(times, reference[:, 0], reference[:, 1 + i]))
        figure = go.Figure().add_scatter(x=times - strike, y=error, name="measured minus reference", line={"color": BLUE})
        made.append(_over_time(figure, f"{name}: error of the angle", "mrad"))
    return made


def _over_time(figure: go.Figure, title: str, unit: str) -> go.Figure:
    figure.add_vline(x=0.0, line={"color": GREY, "width": 1, "dash": "dot"})
    figure.update_xaxes(title_text="s from the strike").update_yaxes(title_text=unit)
    return figure.update_layout(title=title, height=280, showlegend=len(figure.data) > 1)


def main() -> None:
    if len(sys.argv) != 3:
        raise SystemExit(__doc__)
    source = sys.argv[1].split()
    try:
        rows = played(source[0], int(source[1])) if len(source) == 2 and source[1].isdigit() else recorded(Path(sys.argv[1]))
    except TtError as error:
        raise SystemExit(f"swing: {error}") from error
    reference, measured, strike = rows
    at = [np.array([np.interp(strike, r[:, 0], r[:, k]) for k in range(1, 15)]) for r in (reference, measured)]
    off = np.abs(at[1] - at[0])
    worst = f"At the strike q is off by at most {np.degrees(off[:7].max()):.3f} degrees, qdot by {off[7:].max():.3f} rad/s."
    try:
        write_page(Path(sys.argv[2]), html_page(f"Swing of {sys.argv[1]}", [Section(figures=figures(*rows))], lead=[worst]))
    except OSError as error:
        raise SystemExit(f"swing: {error}") from error
    print(f"{sys.argv[2]}: {worst}")


if __name__ == "__main__":
    main()
