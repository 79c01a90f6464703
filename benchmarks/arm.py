"""The arm: what it reaches and how fast, what the dissertation's choice of posture and joint speeds costs, and the torque it takes."""

from __future__ import annotations

import time

import numpy as np
from postures import figures
from report import arguments, report
from tt_arm.control import ArmControl, warm
from tt_arm.joints import Joints
from tt_arm.model import ArmModel
from tt_arm.reach import ReachParams, reach
from tt_arm.stroke_selection import SelectionParams, select_stroke
from tt_arm.swing import PROFILE_NAMES, Swing, SwingLimits, plan
from tt_arm.trajectory.torque import torque_shares
from tt_core.states import RacketState
from tt_eval.arm_loop import arm_ticks
from tt_sim.world.plant import Plant

MODEL = ArmModel.pa10()
WAITING = Joints(0.0, MODEL.waiting, np.zeros(7))
TICK = 0.002  # s
PRINTED = {  # Tables 4.3 and 4.5(c), positions from the text
    "4.3 case 1": ((-0.15, 0.70, 0.25), (1.48, 0.095, 1.41), -0.011, 0.792),
    "4.3 case 2": ((-0.15, 0.70, 0.25), (0.65, 0.064, 1.72), -0.012, 1.66),
    "4.3 case 3": ((-0.15, 0.70, 0.25), (1.48, 0.23, 1.30), 0.31, 1.25),
    "4.5 backspin": ((-0.30, 0.66, 0.23), (1.26, -0.18, 1.75), -0.068, 0.708),
    "4.5 topspin": ((-0.14, 0.73, 0.26), (1.15, 0.019, 0.64), -0.028, 1.814),
}


def asked(rng: np.random.Generator, strike: float) -> RacketState:
    """A return stroke in the middle half of the table's width."""
    position = rng.uniform([-0.35, 0.40, 0.12], [0.0, 1.125, 0.45])
    velocity = rng.uniform([0.5, -0.3, 0.2], [1.6, 0.3, 1.7])
    return RacketState(strike, position, velocity, rng.normal(0.0, 0.12), rng.uniform(0.7, 1.8))


def torque(swing: Swing) -> float:
    """Largest share of the rated torque (assumed inertias, assumed gears) along the path."""
    return float(torque_shares(MODEL, swing.end_time - swing.start.time, 5e-3, swing.knots, swing.coefficients).max())


def miss(racket: RacketState) -> tuple[float, float]:
    """mm and degrees at the strike, by the simulated arm."""
    control, plant = ArmControl(MODEL), Plant(MODEL)
    control.enable(True)
    control.step(WAITING)
    control.take([racket])
    ticks = arm_ticks(control, plant, WAITING, TICK, np.random.default_rng(0))
    joints, step = next(tick for tick in ticks if tick.joints.time + TICK > racket.time)
    there = plant.racket(joints, step.command, racket.time - joints.time)
    angle = np.degrees(np.arccos(min(1.0, float(there.rotation[:, 2] @ racket.normal))))
    return 1e3 * float(np.linalg.norm(there.position - racket.position)), float(angle)


def main() -> None:
    given = arguments("arm", 10000)
    rng, metrics = np.random.default_rng(0), {}
    warm(MODEL)
    metrics |= figures(given.runs)
    printed = {name: RacketState(0.4, np.array(p), np.array(v), alpha, beta) for name, (p, v, alpha, beta) in PRINTED.items()}
    for name, racket in printed.items():
        for method in ("best", "near", "liu"):
            metrics[f"{name}: share of the speed limits, {method}"] = reach(MODEL, racket, MODEL.waiting, method=method).ratio  # type: ignore[arg-type]
        metrics[f"{name}: face turns, rad/s"] = reach(MODEL, racket, MODEL.waiting).turning
    for acceleration, profile in ((10.0, "auto"), (15.0, "auto"), *((20.0, profile) for profile in PROFILE_NAMES)):
        limits = SwingLimits(acceleration=acceleration, profile=profile)
        found = [select_stroke(MODEL, [racket], WAITING, limits, ReachParams(), SelectionParams()) for racket in printed.values()]
        swings = [plan(MODEL, WAITING, reach(MODEL, racket, MODEL.waiting), 1.0, limits) for racket in printed.values()]
        label = f"{acceleration:.0f} rad/s^2, {profile}"
        metrics[f"printed strikes made in 0.40 s, {label}"] = float(sum(choice.swing is not None for choice in found))
        metrics[f"swing time, worst of five, s, {label}"] = max(swing.earliest for swing in swings)
        made = [
            plan(MODEL, WAITING, reach(MODEL, r, MODEL.waiting), s.earliest + 1e-3, limits)
            for r, s in zip(printed.values(), swings, strict=True)
        ]
        metrics[f"rated torque at that, {label}"] = max(torque(swing) for swing in made)
    misses = np.array([miss(racket) for racket in (RacketState(0.5, r.position, r.velocity, r.alpha, r.beta) for r in printed.values())])
    metrics["miss of the simulated racket, worst of five, mm"], metrics["miss of its normal, degrees"] = misses.max(axis=0)

    for left in (0.4, 0.5, 0.6, 0.8):
        strokes = [asked(rng, left) for _ in range(min(1000, given.runs))]
        start = time.perf_counter()
        made = [select_stroke(MODEL, [stroke], WAITING, SwingLimits(), ReachParams(), SelectionParams()).swing for stroke in strokes]
        metrics[f"planning of one stroke, mean ms ({left} s left)"] = 1e3 * (time.perf_counter() - start) / len(strokes)
        metrics[f"strokes over half the table's width made in {left} s, %"] = 100.0 * np.mean([swing is not None for swing in made])
    report("arm", given.runs, {name: float(value) for name, value in metrics.items()}, given.json)


if __name__ == "__main__":
    main()
