"""Results of one ball as a row of a sweep: numbers and texts by name."""

from __future__ import annotations

import math

import numpy as np
from tt_core.constants import RPM
from tt_core.states import ReturnGoal
from tt_sim.world.outcome import Outcome, Result

from .episode import Episode, spin_error, truth

# SI units but for names with _rpm and _deg; NaN where a ball did not get that far; miss and reason are empty for a return
TEXTS = ("kind", "miss", "reason", "judged_miss", "limit", "limit_joint")
RETURN = ("landing_x", "landing_y", "flight_time", "spin_y", "spin_z", "landing_error", "time_error", "return_spin_error")
NUMBERS = (
    "seed", "scale", "speed", "spin_rpm", "seen", "hit", "landed", "measured_spin_error_rpm", "measured_speed_error_rpm",
    "measured_axis_error_deg", "measured_velocity_error", "hit_x", "hit_y", "hit_z", "hit_offset", "edge", "racket_speed", "asked_x",
    "asked_y", *RETURN, "judged_hit", "judged_landed", *(f"judged_{name}" for name in RETURN), "arm_back",
)  # fmt: skip


def sweep_metrics(episode: Episode) -> dict[str, float | str]:
    """Return the row of a ball: all of TEXTS and NUMBERS.

    `speed` and `spin_rpm` are those of the launch. See `limit` for `limit` and `limit_joint`. Names with "judged" are by the wide
    cameras alone, all others are true. `arm_back` is the time (s) after the launch when the arm waits again.
    """
    trial, outcome, goal, selection = episode.trial, episode.outcome, episode.goal, episode.selection
    judged = episode.judged
    row: dict[str, float | str] = dict.fromkeys(NUMBERS, math.nan)
    row |= {
        "kind": trial.kind,
        "miss": str(episode.miss or ""),
        "reason": str(episode.reason or ""),
        "judged_miss": str(episode.judged_miss or ""),
        **limit(episode),
    }
    row |= {"seed": trial.seed, "scale": trial.scale, "seen": episode.measured is not None}
    row |= {"speed": float(np.linalg.norm(trial.ball.velocity)), "spin_rpm": float(np.linalg.norm(trial.ball.spin)) / RPM}
    if episode.measured is not None:
        true = truth(episode, episode.measured.time)
        measured, asked = np.linalg.norm(episode.measured.spin), np.linalg.norm(true[6:])
        along = float(episode.measured.spin @ true[6:]) / max(1e-9, float(measured * asked))
        row["measured_spin_error_rpm"] = (spin_error(episode) or 0.0) / RPM
        row["measured_speed_error_rpm"] = float(measured - asked) / RPM
        row["measured_axis_error_deg"] = math.degrees(math.acos(min(1.0, along)))
        row["measured_velocity_error"] = float(np.linalg.norm(episode.measured.velocity - true[3:6]))
    if selection is not None and selection.swing is not None and selection.racket is not None:
        row["arm_back"] = selection.swing.end_time - trial.ball.time
        row["racket_speed"] = float(np.linalg.norm(selection.racket.velocity))
    if outcome.hit is not None:
        row |= dict(zip(("hit_x", "hit_y", "hit_z"), outcome.hit.before.position.tolist(), strict=True))
        row |= {"hit_offset": outcome.hit.offset, "edge": outcome.hit.edge}
    if goal is not None:
        row |= {"asked_x": float(goal.landing[0]), "asked_y": float(goal.landing[1])}
    for who, prefix in ((outcome, ""), (judged, "judged_")):
        row |= {f"{prefix}hit": who.hit is not None, f"{prefix}landed": who.result is Result.RETURNED}
        if goal is not None:
            row |= {f"{prefix}{name}": value for name, value in _returned(who, goal).items()}
    return {key: value if isinstance(value, str) else float(value) for key, value in row.items()}


def limit(episode: Episode) -> dict[str, str]:
    """Return what kept the arm from the best of its strokes: `limit`, the name of the code, and `limit_joint`, if it is about a joint.

    Both are empty where the arm made a stroke, or was offered none.
    """
    selection = episode.selection
    if selection is None or selection.index is not None or not selection.reasons:
        return {"limit": "", "limit_joint": ""}
    failure = selection.reasons[0].failure
    return {"limit": failure.code.name, "limit_joint": failure.values.get("joint", "")}


def _returned(outcome: Outcome, goal: ReturnGoal) -> dict[str, float]:
    """Return all of RETURN for a ball that came back, nothing for another."""
    hit, landing = outcome.hit, outcome.landing
    if hit is None or landing is None or outcome.result is not Result.RETURNED:
        return {}
    (x, y, _), (_, spin_y, spin_z) = landing.before.position.tolist(), hit.after.spin.tolist()
    flight_time = landing.before.time - hit.before.time
    off, spin_off = math.hypot(x - goal.landing[0], y - goal.landing[1]), math.hypot(spin_y - goal.spin_y, spin_z - goal.spin_z)
    return dict(zip(RETURN, (x, y, flight_time, spin_y, spin_z, off, flight_time - goal.flight_time, spin_off), strict=True))
