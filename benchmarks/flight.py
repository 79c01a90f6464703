"""Predicting 0.6 s with a bounce: exactness and time beside the source's scheme in numpy and scipy's DOP853, in one process."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
from report import arguments, report
from scipy.integrate import solve_ivp
from tt_core.flight import DRAG_UNIT, LIFT_UNIT, Aerodynamics
from tt_core.path_end import PathEnd
from tt_core.physics import Physics
from tt_core.states import BallState
from tt_predict.rollout import StopRule, rollout

DURATION = 0.6  # s
PHYSICS = Physics.liu()
AIR, TABLE = Aerodynamics.liu(), PHYSICS.table


def acceleration(v: np.ndarray, w: np.ndarray) -> np.ndarray:
    """(3.1)-(3.3) as anyone would write it in numpy."""
    across = v[0] * w[1] - v[1] * w[0]
    h = across / np.sqrt(across**2 + (v[0] ** 2 + v[1] ** 2) * w[2] ** 2)
    drag, lift = (AIR.drag + AIR.drag_h * h) * DRAG_UNIT, (AIR.lift + AIR.lift_h * h) * LIFT_UNIT
    return np.array([0.0, 0.0, -AIR.gravity]) - drag * np.linalg.norm(v) * v + lift * np.cross(w, v)


def numpy_rk4(p: np.ndarray, v: np.ndarray, w: np.ndarray, duration: float, h: float = 1.0 / 1200.0) -> np.ndarray:
    """(4.59)-(4.61), the bounce at the first step that is at or below the contact height."""
    for _ in range(round(duration / h)):
        k1 = h * acceleration(v, w)
        k2 = h * acceleration(v + k1 / 2, w)
        k3 = h * acceleration(v + k2 / 2, w)
        k4 = h * acceleration(v + k3, w)
        p = p + h * (v + (v + k1 / 2) * 2 + (v + k2 / 2) * 2 + (v + k3)) / 6
        v = v + (k1 + 2 * k2 + 2 * k3 + k4) / 6
        if p[2] <= PHYSICS.contact_height and v[2] < 0.0:
            v, w = TABLE.after(v, w)
    return p


def dop853(p: np.ndarray, v: np.ndarray, w: np.ndarray, duration: float, rtol: float, max_step: float = np.inf) -> np.ndarray:
    """The end of the flight, the bounce by scipy's events on dense output."""

    def table(_: float, y: np.ndarray) -> float:
        return float(y[2] - PHYSICS.contact_height)

    table.terminal, table.direction = True, -1  # type: ignore[attr-defined]
    t, y = 0.0, np.concatenate([p, v])
    while True:
        solution = solve_ivp(
            lambda _, y, w=w: np.concatenate([y[3:], acceleration(y[3:], w)]),
            (t, duration),
            y,
            "DOP853",
            events=table,
            rtol=rtol,
            atol=1e-14,
            max_step=max_step,
        )
        t, y = solution.t[-1], solution.y[:, -1]
        if solution.status != 1:
            return y[:3]
        v, w = TABLE.after(y[3:], w)
        y = np.concatenate([y[:2], [PHYSICS.contact_height + 1e-16], v])


def balls(count: int, seed: int = 0) -> list[BallState]:
    """Shots of all kinds that bounce once on the robot's half in 0.6 s."""
    rng, found = np.random.default_rng(seed), []
    while len(found) < count:
        velocity = [rng.uniform(-8, -4), rng.uniform(-0.4, 0.4), rng.uniform(-0.5, 2.5)]
        ball = BallState(0.0, [2.62, rng.uniform(0.4, 1.1), rng.uniform(0.2, 0.4)], velocity, rng.uniform(-400, 400, 3))
        path = rollout(ball, PHYSICS, StopRule.at_time(DURATION))
        if path.ended is PathEnd.STOP and len(path.bounces) == 1 and path.bounces[0].position[0] < 1.3:
            found.append(ball)
    return found


def timed(call: Callable[[], object], repeats: int) -> float:
    """s of processor time of one call, after one that warms it: other processes do not count."""
    call()
    start = time.process_time()
    for _ in range(repeats):
        call()
    return (time.process_time() - start) / repeats


def main() -> None:
    args = arguments("flight", 15)
    stop, shots = StopRule.at_time(DURATION), balls(args.runs)
    errors: dict[str, list[float]] = {"rollout": [], "rollout liu": [], "numpy rk4": [], "dop853": []}
    times: dict[str, list[float]] = {name: [] for name in errors}
    for ball in shots:
        state = ball.position, ball.velocity, ball.spin
        reference = dop853(*state, DURATION, 1e-13, 2e-3)
        calls: dict[str, tuple[Callable[[], np.ndarray], int]] = {
            "rollout": (lambda ball=ball: rollout(ball, PHYSICS, stop).end.position, 300),  # type: ignore[misc]
            "rollout liu": (lambda ball=ball: rollout(ball, PHYSICS, stop, method="liu").end.position, 30),  # type: ignore[misc]
            "numpy rk4": (lambda state=state: numpy_rk4(*state, DURATION), 1),  # type: ignore[misc]
            "dop853": (lambda state=state: dop853(*state, DURATION, 1e-9), 1),  # type: ignore[misc]
        }
        for name, (call, repeats) in calls.items():
            errors[name].append(math.dist(call(), reference))
            times[name].append(timed(call, repeats))
    metrics = {f"error of {name}, largest, m": max(values) for name, values in errors.items()}
    metrics |= {f"time of {name}, median, us": 1e6 * float(np.median(values)) for name, values in times.items()}
    ours = np.median(times["rollout"])
    metrics |= {f"rollout is faster than {name}, times": float(np.median(times[name]) / ours) for name in list(times)[1:]}
    report("flight", args.runs, metrics, args.json)


if __name__ == "__main__":
    main()
