"""One ball's figures, flat and comparable: the rows of a sweep."""

from __future__ import annotations

import math

import numpy as np
from tt_core.constants import RPM
from tt_core.flight import fly

from .episode import Episode, landing_error, spin_error

# SI units but for rpm; NaN where a ball did not get that far. Strings: kind, miss, reason, empty when it came back.
TEXTS = ("kind", "miss", "reason")
NUMBERS = (
    "seed", "scale", "speed", "spin_rpm", "seen", "hit", "landed", "measured_spin_error_rpm", "measured_velocity_error", "hit_x", "hit_y",
    "hit_z", "hit_offset", "edge", "racket_speed", "landing_x", "landing_y", "asked_x", "asked_y", "landing_error", "time_error",
    "return_spin_error", "arm_back",
)  # fmt: skip


def figures(episode: Episode) -> dict[str, float | str]:
    """All of TEXTS and NUMBERS. speed and spin_rpm: of the launch. arm_back: s, after the launch, when the arm waits again."""
    trial, outcome, goal, choice = episode.trial, episode.outcome, episode.goal, episode.choice
    row: dict[str, float | str] = dict.fromkeys(NUMBERS, math.nan)
    row |= {"kind": trial.kind, "miss": episode.miss or "", "reason": episode.reason or "", "seed": trial.seed, "scale": trial.scale}
    row |= {"speed": float(np.linalg.norm(trial.ball.velocity)), "spin_rpm": float(np.linalg.norm(trial.ball.spin)) / RPM}
    row |= {"seen": episode.measured is not None, "hit": outcome.hit is not None, "landed": outcome.result == "returned"}
    if episode.measured is not None:
        time = episode.measured.time - trial.scenario.world.cameras.clock_offset - trial.ball.time
        true = fly(trial.ball.vector, time, trial.physics.air.coefficients)
        row["measured_spin_error_rpm"] = (spin_error(episode) or 0.0) / RPM
        row["measured_velocity_error"] = float(np.linalg.norm(episode.measured.velocity - true[3:6]))
    if choice is not None and choice.swing is not None and choice.racket is not None:
        row["arm_back"] = choice.swing.end_time - trial.ball.time
        row["racket_speed"] = float(np.linalg.norm(choice.racket.velocity))
    if outcome.hit is not None:
        row |= dict(zip(("hit_x", "hit_y", "hit_z"), outcome.hit.before.position.tolist(), strict=True))
        row |= {"hit_offset": outcome.hit.offset, "edge": outcome.hit.edge}
    if goal is not None:
        row |= {"asked_x": float(goal.landing[0]), "asked_y": float(goal.landing[1])}
    if outcome.hit is not None and outcome.landing is not None and goal is not None and outcome.result == "returned":
        hit, landing = outcome.hit, outcome.landing
        row |= {"landing_x": float(landing.before.position[0]), "landing_y": float(landing.before.position[1])}
        row["landing_error"] = landing_error(episode) or 0.0
        row["time_error"] = landing.before.time - hit.before.time - goal.flight_time
        row["return_spin_error"] = float(np.hypot(*(hit.after.spin[1:] - [goal.spin_y, goal.spin_z])))
    return {key: value if isinstance(value, str) else float(value) for key, value in row.items()}
