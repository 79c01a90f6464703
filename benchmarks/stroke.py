"""The stroke: exactness and time beside scipy's solve_bvp, prediction and stroke together, and 10,000 random balls and goals."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable

import numpy as np
from flight import balls, timed
from report import arguments, report
from rich.console import Console
from rich.table import Table
from scipy.integrate import solve_bvp
from tt_core.flight import DRAG_UNIT, LIFT_UNIT, fly
from tt_core.path_end import PathEnd
from tt_core.physics import Physics
from tt_core.states import BallState, ReturnGoal
from tt_predict.rollout import StopRule, rollout
from tt_racket.baselines import fixed_pitch, specular
from tt_racket.stroke import solve

PHYSICS = Physics.liu()
REPEATS = 15  # interleaved


def by_solve_bvp(ball: BallState, goal: ReturnGoal) -> np.ndarray:
    """(6,) velocity and spin after the hit: flight and spin condition (4.16) as one boundary value problem, spin x its parameter."""
    air, p0, v0, w0 = PHYSICS.air, ball.position, ball.velocity, ball.spin
    target, duration = np.append(goal.landing, PHYSICS.contact_height), goal.flight_time

    def flight(_: np.ndarray, y: np.ndarray, p: np.ndarray) -> np.ndarray:
        vx, vy, vz = v = y[3:]
        wx, wy, wz = p[0], goal.spin_y, goal.spin_z
        across = vx * wy - vy * wx
        h = across / np.sqrt(across**2 + (vx**2 + vy**2) * wz**2)
        drag, lift = (air.drag + air.drag_h * h) * DRAG_UNIT, (air.lift + air.lift_h * h) * LIFT_UNIT
        magnus = lift * np.array([wy * vz - wz * vy, wz * vx - wx * vz, wx * vy - wy * vx])
        return np.vstack([v, -drag * np.linalg.norm(v, axis=0) * v + magnus - np.array([[0], [0], [air.gravity]])])

    def ends(a: np.ndarray, b: np.ndarray, p: np.ndarray) -> np.ndarray:
        return np.concatenate([a[:3] - p0, b[:3] - target, [(a[3:] - v0) @ (np.array([p[0], goal.spin_y, goal.spin_z]) - w0)]])

    start = solve(ball, goal, PHYSICS, method="sam").ball_after
    velocity = start.velocity if start else (target - p0) / duration + [0, 0, 0.5 * air.gravity * duration]
    times = np.linspace(0.0, duration, 10)
    guess = np.vstack([p0[:, None] + np.outer(target - p0, times / duration), np.repeat(velocity[:, None], 10, axis=1)])
    found = solve_bvp(flight, ends, times, guess, p=[w0[0]], tol=1e-6)
    return np.array([*found.y[3:, 0], found.p[0], goal.spin_y, goal.spin_z])


def off(ball: BallState, goal: ReturnGoal, after: np.ndarray) -> float:
    """m from the goal at the asked time."""
    end = fly(np.concatenate([ball.position, after]), goal.flight_time, PHYSICS.air.coefficients, 2e-3)
    return math.dist(end[:3], (*goal.landing, PHYSICS.contact_height))


def beside_solve_bvp() -> dict[str, float]:
    cases, seed = [], 0
    while len(cases) < REPEATS:
        for shot in balls(REPEATS, seed):
            ball, goal = rollout(shot, PHYSICS, StopRule.at_x(-0.2)).end, ReturnGoal([2.055, 0.7625], 0.55, 50.0, 20.0)
            if len(cases) < REPEATS and solve(ball, goal, PHYSICS).racket:
                cases.append((ball, goal))
        seed += 1
    ours, theirs, our_miss, their_miss = [], [], [], []
    for ball, goal in cases:
        calls: tuple[Callable[[], object], ...] = (lambda: solve(ball, goal, PHYSICS), lambda: by_solve_bvp(ball, goal))  # noqa: B023
        ours.append(timed(calls[0], 300))
        theirs.append(timed(calls[1], 1))
        after = solve(ball, goal, PHYSICS).ball_after
        assert after is not None
        our_miss.append(off(ball, goal, after.vector[3:]))
        their_miss.append(off(ball, goal, by_solve_bvp(ball, goal)))
    others = {
        "sam": [solve(*case, PHYSICS, method="sam").residual for case in cases],
        "Acosta's": [specular(*case, PHYSICS).residual for case in cases],
        "Yang's": [fixed_pitch(*case, PHYSICS).residual for case in cases],
    }
    return {f"landing error of {name}, median, m": float(np.median(values)) for name, values in others.items()} | {
        "landing error of solve, largest, m": max(our_miss),
        "landing error of solve_bvp at 1e-6, largest, m": max(their_miss),
        "time of solve, median, us": 1e6 * float(np.median(ours)),
        "time of solve_bvp, median, us": 1e6 * float(np.median(theirs)),
        "solve is faster than solve_bvp, times": float(np.median(theirs) / np.median(ours)),
    }


def predict_and_solve(count: int) -> dict[str, float]:
    """From the measured ball to the racket, each call timed."""
    stop, goal, shots = StopRule.at_x(-0.2), ReturnGoal([2.055, 0.7625], 0.55, 50.0, 20.0), balls(200, 7)
    took = []
    for i in range(count + 200):
        shot = shots[i % len(shots)]
        start = time.perf_counter()
        solve(rollout(shot, PHYSICS, stop).end, goal, PHYSICS)
        took.append(1e6 * (time.perf_counter() - start))
    median, late = np.percentile(took[200:], [50, 99])
    return {"predict and solve, median, us": float(median), "predict and solve, 99th percentile, us": float(late)}


def random_goals(count: int) -> dict[str, float]:
    """Every ball and goal ends as solved, and then does what it should when simulated, or as infeasible with the reason."""
    rng, reasons = np.random.default_rng(0), Counter[str]()
    place_error, time_error = 0.0, 0.0
    for _ in range(count):
        position = [rng.uniform(-0.4, 0.0), rng.uniform(0.1, 1.4), rng.uniform(0.1, 0.6)]
        velocity = [rng.uniform(-8, -1), rng.uniform(-1.5, 1.5), rng.uniform(-3, 3)]
        ball = BallState(0.0, position, velocity, rng.uniform(-400, 400, 3))
        landing = [rng.uniform(1.37, 2.74), rng.uniform(0.0, 1.525)]
        goal = ReturnGoal(landing, rng.uniform(0.2, 1.0), rng.uniform(-400, 400), rng.uniform(-400, 400))
        stroke = solve(ball, goal, PHYSICS)
        if stroke.racket is None:
            assert stroke.reason is not None
            reasons[stroke.reason.code.name] += 1
            continue
        after = PHYSICS.racket.after(ball.velocity, ball.spin, stroke.racket)
        path = rollout(BallState(0.0, ball.position, *after), PHYSICS, StopRule.at_landing())
        assert path.ended is PathEnd.STOP, (ball, goal, path.ended)
        reasons["solved"] += 1
        place_error = max(place_error, math.dist(path.end.position[:2], landing))
        time_error = max(time_error, abs(path.end.time - goal.flight_time))
    table = Table("end", "count", title=f"{count} random balls and goals")
    for reason, number in reasons.most_common():
        table.add_row(reason, str(number))
    Console().print(table)
    return {
        "random goals, solved": reasons["solved"],
        "random goals, infeasible with the reason": sum(reasons.values()) - reasons["solved"],
        "random goals, landing error simulated, largest, m": place_error,
        "random goals, time error simulated, largest, s": time_error,
    }


def main() -> None:
    args = arguments("stroke", 10_000)
    metrics = beside_solve_bvp() | predict_and_solve(min(args.runs, 5000)) | random_goals(args.runs)
    report("stroke", args.runs, metrics, args.json)


if __name__ == "__main__":
    main()
