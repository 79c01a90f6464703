"""Strokes as they come in play, made by an arm with lag and noise: how many, how well, and whether a limit is ever broken.

And IN_A_ROW balls at the most that the machine throws, one arm for all of them, which comes from wherever it is.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
from report import arguments, report
from rich.console import Console
from tt_arm.control import ArmControl, warm
from tt_arm.joints import Joints
from tt_arm.model import ArmModel
from tt_core.states import RacketState
from tt_eval.arm_loop import arm_ticks
from tt_eval.arm_trial import STROKES_AT, TRIAL_TICK, arm_trial, launched_ball_strokes
from tt_sim.world.launcher import SHOT_KINDS
from tt_sim.world.plant import Plant, PlantParams

MODEL = ArmModel.pa10()
NOISY = PlantParams(time_constant=0.007, q_noise=5e-5, qdot_noise=5e-3)  # 2 ms slower than the servo believes
SCALES = (3, 4, 5)
IN_A_ROW = 282  # balls, three minutes of them
PERIOD = 60.0 / 94.0  # s, dissertation Section 2.5.2
MADE = 0.01  # m, from its place, within which a racket meets its ball


def in_a_row(balls: int) -> float:
    """The share of strokes that are made, of balls known exactly."""
    control, plant, start = ArmControl(MODEL), Plant(MODEL, NOISY), Joints(0.0, MODEL.waiting, np.zeros(7))
    rng, thrown, made, wanted = np.random.default_rng(0), 0, 0, list[RacketState]()
    control.enable(True)
    for joints, step in arm_ticks(control, plant, start, TRIAL_TICK, rng):
        if joints.time >= balls * PERIOD + 1.0:
            break
        if thrown < balls and joints.time >= thrown * PERIOD + STROKES_AT:
            rackets = launched_ball_strokes(SHOT_KINDS[thrown % len(SHOT_KINDS)], SCALES[thrown % len(SCALES)], thrown)
            choice = control.take([replace(racket, time=racket.time + thrown * PERIOD) for racket in rackets])
            wanted += [choice.racket] if choice.racket is not None else []
            thrown += 1
        for racket in [racket for racket in wanted if racket.time < joints.time + TRIAL_TICK]:
            there = plant.racket(joints, step.command, racket.time - joints.time)
            made += bool(np.linalg.norm(there.position - racket.position) < MADE)
            wanted.remove(racket)
    return made / balls


def main() -> None:
    given = arguments("strokes", 1000)
    warm(MODEL)
    metrics: dict[str, float] = {}
    done, why, guarded = [], Counter(), Counter()
    shots = [(kind, scale) for kind in SHOT_KINDS for scale in SCALES]
    made: Counter[tuple[str, int]] = Counter()
    tried: Counter[tuple[str, int]] = Counter()
    for seed in range(given.runs):
        shot = shots[seed % len(shots)]
        one = arm_trial(MODEL, launched_ball_strokes(*shot, seed), NOISY, seed)
        done.append(one)
        tried[shot] += 1
        made[shot] += one.reason is None
        guarded.update(one.guarded)
        if one.reason is not None:
            why[one.reason.code.name] += 1
    for shot in shots:
        metrics[f"made, {shot[0]} {shot[1]}, %"] = 100.0 * made[shot] / max(1, tried[shot])
    metrics["made, all, %"] = 100.0 * sum(made.values()) / given.runs
    hits = [one for one in done if one.reason is None]
    for name, scale in (("turning", 1.0), ("spare", 1e3), ("back", 1.0), ("miss", 1e3), ("tilt", 180.0 / np.pi)):
        values = scale * np.array([getattr(one, name) for one in hits])
        label = {
            "turning": "face turns, rad/s",
            "spare": "to spare, ms",
            "back": "way back, s",
            "miss": "miss, mm",
            "tilt": "tilt, degrees",
        }[name]
        metrics[f"{label}, median"], metrics[f"{label}, 99 %"] = float(np.median(values)), float(np.quantile(values, 0.99))
    metrics["nearest to a position limit, rad"] = min(one.room for one in done)
    metrics["largest share of a speed limit"] = max(one.speed for one in done)
    metrics["largest acceleration, rad/s^2"] = max(one.acceleration for one in done)
    metrics["least clearance, mm"] = 1e3 * min(one.clear for one in done)
    metrics["strokes in which the guard had to cut"] = float(sum(bool(one.guarded) for one in done))
    for reason, count in why.most_common():
        metrics[f"refused: {reason}"] = float(count)
    metrics[f"made of {IN_A_ROW} balls in a row at 94 a minute, %"] = 100.0 * in_a_row(IN_A_ROW)
    Console().print(dict(guarded))
    report("strokes", given.runs, metrics, given.json)


if __name__ == "__main__":
    main()
