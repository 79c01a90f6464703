"""The last swing of a recording, as dissertation Figures 4.11 to 4.14: python docs/swing.py BAG FILE.html, in the project's environment.

BAG may also be a kind and a scale, as in "top 3": then that ball is played without ROS, its strokes made by the arm with lag.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots
from tt_arm.control import ArmControl
from tt_arm.joints import Joints
from tt_arm.model import ArmModel
from tt_bringup.report import read
from tt_core.errors import TtError
from tt_eval.arm_loop import arm_ticks
from tt_eval.arm_trial import STROKES_AT, TICK, strokes
from tt_eval.page import Section, html_page
from tt_sim.world.plant import Plant, PlantParams

NEEDED = ("arm/swing", "joint_states", "diagnostics")
AROUND = 0.5  # s, shown before and after the strike


def recorded(bag: Path) -> tuple[np.ndarray, np.ndarray, float]:
    """Reference and measured rows (n, 15) of time s, q rad, qdot rad/s, and the time (s) of the strike, the fastest point of the swing."""
    found = read(bag)

    def seconds(t):
        return t.sec + 1e-9 * t.nanosec

    missing = [topic for topic in NEEDED if not found.get(topic)]
    if missing:
        raise SystemExit(f"{bag} holds no {', '.join(missing)}: a recording of a swing is needed")
    swing = found[NEEDED[0]][-1]
    begin = seconds(swing.header.stamp)
    reference = np.array([[begin + seconds(p.time_from_start), *p.positions, *p.velocities] for p in swing.points])
    measured = np.array([[seconds(m.header.stamp), *m.position, *m.velocity] for m in found[NEEDED[1]]])
    swings = [{v.key: v.value for v in s.values} for m in found[NEEDED[2]] for s in m.status if s.name == "arm" and s.message == "swing"]
    return reference, measured, float(swings[-1]["strike"])


def played(kind: str, scale: int) -> tuple[np.ndarray, np.ndarray, float]:
    """The same of a ball of seed 0."""
    model = ArmModel.pa10()
    control, plant, start, choice, rows = ArmControl(model), Plant(model, PlantParams()), Joints(0.0, model.waiting, np.zeros(7)), None, []
    control.enable(True)
    for joints, _ in arm_ticks(control, plant, start, TICK, np.random.default_rng(0)):
        if joints.time >= 2.5:
            break
        if choice is None and joints.time >= STROKES_AT:
            choice = control.take(strokes(kind, scale, 0))
            if choice.swing is None:
                raise SystemExit(f"{kind} {scale}: {'; '.join(map(str, choice.reasons))}")
        rows.append([joints.time, *joints.q, *joints.qdot])
    times = np.array([row[0] for row in rows])
    reference = np.array([[t, *np.hstack(choice.swing.sample(t))] for t in times])
    return reference, np.array(rows), choice.swing.strike_time


def figure(reference: np.ndarray, measured: np.ndarray, strike: float) -> go.Figure:
    """q on the left and qdot on the right of each joint, s from the strike."""
    names = ArmModel.pa10().names
    made = make_subplots(rows=7, cols=2, shared_xaxes=True, vertical_spacing=0.015)
    for rows, name, style in ((reference, "reference", {"color": "#1b5e9b"}), (measured, "measured", {"color": "#c0392b", "dash": "dot"})):
        shown = rows[np.abs(rows[:, 0] - strike) < AROUND]
        for i in range(7):
            for column, first, unit in ((1, 1, "rad"), (2, 8, "rad/s")):
                place = {"row": i + 1, "col": column}
                made.add_scatter(x=shown[:, 0] - strike, y=shown[:, first + i], name=name, line=style, showlegend=i + column == 1, **place)
                made.update_yaxes(title_text=f"{names[i]}, {unit}", **place)
    made.add_vline(x=0.0, line={"color": "#999", "width": 1})
    for column in (1, 2):
        made.update_xaxes(title_text="s from the strike", row=7, col=column)
    return made.update_layout(height=1400, title="Joint angles and speeds around the strike")


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
    try:
        Path(sys.argv[2]).write_text(html_page(f"Swing of {sys.argv[1]}", [Section(figures=[figure(*rows)])]))
    except OSError as error:
        raise SystemExit(f"swing: {error}") from error
    print(f"{sys.argv[2]}: at the strike q is off by at most {np.degrees(off[:7].max()):.3f} degrees, qdot by {off[7:].max():.3f} rad/s")


if __name__ == "__main__":
    main()
