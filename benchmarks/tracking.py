"""The tracker on recorded launches, positions alone, and on simulated balls that wide cameras see (TT_DATA_DIR names the recordings).

Recorded: of each group of launches every second one, from the first on, is used to fit drag, lift, table, and how large spins are; the
others are scored. The tracker sees the positions of the first 0.2 s and predicts 0.1, 0.2, 0.3 and 0.5 s ahead. Peers see the same: a
parabola, and gravity with a drag that was fitted to the same half. Published, on launches of this machine: 1.3 cm at 0.1 s and 8.7 cm at
0.5 s in the median (Achterhold et al. 2023).

Simulated: balls of the launcher in the world `real`, with coefficients of their own, seen by two wide cameras with 0.15 pixels of noise.
NEES is the squared error of a state over its covariance, NIS that of a pixel, before it is taken, over the covariance of its prediction;
both per dimension. Beside the tracker stands an extended Kalman filter of flight alone, which knows no table.
"""

from __future__ import annotations

import copy
import os
import time
from pathlib import Path

import numpy as np
from report import arguments, report
from tt_core.flight import Aerodynamics
from tt_core.physics import Physics
from tt_core.states import BallState
from tt_predict.identify import Predictor, identify
from tt_predict.recordings import aimy
from tt_predict.rollout import StopRule, rollout
from tt_sim.world.launcher import LauncherParams, launch
from tt_sim.world_file import load_world
from tt_vision.rig import WIDE_RATE, wide_pair
from tt_vision.tracking import Tracker, TrackerParams

SEEN = 0.2  # s
AHEAD = (0.1, 0.2, 0.3, 0.5)  # s
SIGMA = 0.0024  # m, of a recorded position: residuals of the fitted half are 1.6 mm, and half as much again because they last
SPIN_WEIGHT = 0.03  # see TrackerParams: the spins of the groups differ fifty-fold
COEFFICIENTS = ["air.drag", "air.lift_ratio", "table.restitution", "table.friction", "table.grip"]
HORIZON = 0.1  # s ahead, of predictions that are compared with those of the filter
NOISE = 0.15  # pixels, of the world `real`
MEASURED = np.repeat([5e-4, 0.02, 5.0], 3)  # m, m/s, rad/s: standard deviations of a measured ball
PROCESS = 10.0  # m/s per root of s: acceleration that the filter of flight alone allows for; of 10, 40, 100 and 200 the best
FAULTS = ("none", "lost", "outliers", "jitter", "one_camera")


def spin_spread(flights, physics):
    """Return the root mean square of the spin components in rad/s that the tracker finds in whole flights, through their bounces."""
    spins = []
    for flight in flights:
        tracker = Tracker(physics, params=TrackerParams(lag=2.0))
        for t, place in zip(flight.times, flight.positions, strict=True):
            tracker.add_position(t, place, np.eye(3) * SIGMA**2)
        spins.append(tracker.state(flight.times[0]).spin)
    return float(np.sqrt(np.mean(np.square(spins))))


def recorded(folder):
    """Return errors in m by (predictor, s ahead, group)."""
    flights = aimy(folder)
    groups = sorted({flight.group for flight in flights})
    halves = [[flight for flight in flights if flight.group == group] for group in groups]
    fitted, scored = [f for half in halves for f in half[::2]], [f for half in halves for f in half[1::2]]
    physics = identify(fitted, Physics.measured(), COEFFICIENTS).physics
    params = TrackerParams(spin_spread=spin_spread(fitted, physics), spin_weight=SPIN_WEIGHT)
    plain = Physics(Aerodynamics(physics.air.drag, 0.0, 0.0, 0.0), physics.table)
    plain = identify(fitted, plain, ["air.drag"]).physics
    errors = {}
    for flight in scored:
        n = int(np.searchsorted(flight.times - flight.times[0], SEEN))
        tracker = Tracker(physics, params=params)
        for t, place in zip(flight.times[:n], flight.positions[:n], strict=True):
            tracker.add_position(t, place, np.eye(3) * SIGMA**2)
        parabola = np.polynomial.polynomial.polyfit(flight.times[:n] - flight.times[0], flight.positions[:n], 2)
        drag_only = Predictor(plain)
        start = drag_only.start(flight, np.zeros(3), n)
        for ahead in AHEAD:
            i = int(np.searchsorted(flight.times, flight.times[n - 1] + ahead))
            if i == len(flight.times):
                continue
            found = {
                "tracker": tracker.state(flight.times[i]).position,
                "parabola": np.polynomial.polynomial.polyval(flight.times[i] - flight.times[0], parabola),
                "gravity_drag": drag_only.positions(start, flight.times[[0, i]])[1],
            }
            for name, place in found.items():
                errors.setdefault((name, ahead, flight.group), []).append(np.linalg.norm(place - flight.positions[i]))
    return errors


def flown(seed):
    """Return random numbers, world, ball at the launch, and its true path with coefficients of its own."""
    rng, world = np.random.default_rng(seed), load_world("real")
    ball_physics = world.domain_randomization.draw(world.of_session(seed).physics, rng)
    ball, _ = launch("mixed", int(rng.integers(3, 6)), LauncherParams(), rng)
    path = rollout(ball, ball_physics, StopRule.at_x(-0.4))
    return rng, world, ball, path


def simulated(seed, announced, fault):
    """Return rows of one ball: s after the bounce, NEES per dimension, s that a state took, error (9,) of the state, sigmas (9,)."""
    rng, world, ball, path = flown(seed)
    tracker, cameras, rows = Tracker(world.physics, wide_pair()), wide_pair(), []
    if announced:
        seen = ball.vector + MEASURED * rng.normal(size=9)
        tracker.start(BallState.from_vector(0.0, seen, np.diag(MEASURED**2)))
    frames = []
    for stamp in np.arange(rng.uniform() / WIDE_RATE, path.times[-1], 1.0 / WIDE_RATE):
        for index, camera in enumerate(cameras):
            if (fault == "lost" and rng.uniform() < 0.3) or (fault == "one_camera" and index == 1):
                continue
            off = rng.normal(size=3)
            off *= 0.2 / np.linalg.norm(off) if fault == "outliers" and rng.uniform() < 0.05 else 0.0
            pixel = camera.project(path.at(stamp).position[None] + off)[0] + rng.normal(0.0, NOISE, 2)
            frames.append((stamp + (rng.uniform(0.0, 0.02) if fault == "jitter" else 0.0), stamp, index, pixel))
    bounce = path.bounces[0].time if path.bounces else np.inf
    frames.sort(key=lambda frame: frame[0])
    for k, (_, stamp, index, pixel) in enumerate(frames):
        tracker.add_pixel(stamp, index, pixel, NOISE)
        if k % 2:
            began = time.perf_counter()
            state = tracker.state()
            took = time.perf_counter() - began
            if state is not None:
                e = state.vector - path.at(state.time).vector
                rows.append(
                    (state.time - bounce, e @ np.linalg.solve(state.covariance, e) / 9.0, took, *e, *np.sqrt(np.diag(state.covariance)))
                )
    return rows


def slopes(camera, place):
    """Derivative (2, 3) of the pixel by the place, pixels/m."""
    steps = 1e-4 * np.eye(3)
    return ((camera.project(place + steps) - camera.project(place - steps)) / 2e-4).T


def innovation(tracker, camera, stamp, pixel):
    """NIS per dimension of a pixel before it is taken; None while there is no ball."""
    predicted = tracker.state(stamp)
    if predicted is None:
        return None
    off, j = pixel - camera.project(predicted.position[None])[0], slopes(camera, predicted.position)
    return off @ np.linalg.solve(j @ predicted.covariance[:3, :3] @ j.T + NOISE**2 * np.eye(2), off) / 2.0


class FlightFilter:
    """Extended Kalman filter of place and velocity with gravity and drag, which knows no table."""

    def __init__(self, ball, air):
        self.time, self.state, self.covariance, self.air = ball.time, ball.vector[:6].copy(), ball.covariance[:6, :6].copy(), air

    def predict(self, stamp):
        step, v = stamp - self.time, self.state[3:]
        pull = self.air.acceleration(v, np.zeros(3))
        by_velocity = np.column_stack([(self.air.acceleration(v + e, np.zeros(3)) - pull) / 1e-3 for e in 1e-3 * np.eye(3)])
        along = np.eye(6) + np.block([[np.zeros((3, 3)), step * np.eye(3)], [np.zeros((3, 3)), step * by_velocity]])
        noise = PROCESS**2 * np.kron([[step**3 / 3, step**2 / 2], [step**2 / 2, step]], np.eye(3))
        self.state = np.concatenate([self.state[:3] + step * v + 0.5 * step**2 * pull, v + step * pull])
        self.covariance, self.time = along @ self.covariance @ along.T + noise, stamp

    def take(self, stamp, camera, pixel):
        if stamp > self.time:
            self.predict(stamp)
        h = np.hstack([slopes(camera, self.state[:3]), np.zeros((2, 3))])
        gain = self.covariance @ h.T @ np.linalg.inv(h @ self.covariance @ h.T + NOISE**2 * np.eye(2))
        self.state = self.state + gain @ (pixel - camera.project(self.state[None, :3])[0])
        self.covariance = (np.eye(6) - gain @ h) @ self.covariance


def compared(seed):
    """Return rows of one ball: s after the bounce, errors in m, 0.1 s ahead, of the tracker and of the filter; and its NIS values."""
    rng, world, ball, path = flown(seed)
    cameras, rows, nis = wide_pair(), [], []
    seen = BallState.from_vector(0.0, ball.vector + MEASURED * rng.normal(size=9), np.diag(MEASURED**2))
    tracker, flight = Tracker(world.physics, cameras), FlightFilter(seen, world.physics.air)
    tracker.start(seen)
    for stamp in np.arange(rng.uniform() / WIDE_RATE, path.times[-1] - HORIZON, 1.0 / WIDE_RATE):
        for index, camera in enumerate(cameras):
            pixel = camera.project(path.at(stamp).position[None])[0] + rng.normal(0.0, NOISE, 2)
            if (value := innovation(tracker, camera, stamp, pixel)) is not None:
                nis.append(value)
            tracker.add_pixel(stamp, index, pixel, NOISE)
            flight.take(stamp, camera, pixel)
        true, found = path.at(stamp + HORIZON).position, tracker.state(stamp + HORIZON)
        ahead = copy.copy(flight)
        ahead.predict(stamp + HORIZON)
        if found is not None and path.bounces:
            rows.append((stamp - path.bounces[0].time, np.linalg.norm(found.position - true), np.linalg.norm(ahead.state[:3] - true)))
    return rows, nis


def main():
    args = arguments("tracking", 200)
    metrics = {}
    folder = os.environ.get("TT_DATA_DIR")
    if folder:
        errors = recorded(Path(folder) / "aimy")
        for name in ("tracker", "parabola", "gravity_drag"):
            for ahead in AHEAD:
                of_all = np.concatenate([e for (who, when, _), e in errors.items() if (who, when) == (name, ahead)])
                metrics[f"{name}_{ahead:g}_s_median_m"], metrics[f"{name}_{ahead:g}_s_p95_m"] = np.median(of_all), np.quantile(of_all, 0.95)
            no_spin = np.array(errors[name, 0.5, "mn5008_no_spin"] + errors[name, 0.5, "no_spin_robot_simple"])
            metrics[f"{name}_bounce_0.5_s_no_spin_median_m"] = np.median(no_spin)
            metrics[f"{name}_bounce_0.5_s_no_spin_p95_m"] = np.quantile(no_spin, 0.95)
        metrics["published_0.1_s_median_m"], metrics["published_0.5_s_median_m"] = 0.013, 0.087
    else:
        print("TT_DATA_DIR names no folder of recorded launches: simulated balls only")
    for name, announced, fault in [("measured", True, f) for f in FAULTS] + [("wide", False, f) for f in FAULTS[:4]]:
        runs = args.runs if fault == "none" else max(20, args.runs // 5)
        rows = np.array([row for seed in range(runs) for row in simulated(seed, announced, fault)])
        prefix = f"{name}_{fault}_"
        metrics[prefix + "nees"], metrics[prefix + "state_ms_median"] = rows[:, 1].mean(), 1e3 * np.median(rows[:, 2])
        metrics[prefix + "state_ms_p99"] = 1e3 * np.quantile(rows[:, 2], 0.99)
        late = rows[(rows[:, 0] > 0.08) & (rows[:, 0] < 0.3)]
        metrics[prefix + "position_median_m"] = np.median(np.linalg.norm(late[:, 3:6], axis=1))
        metrics[prefix + "position_p95_m"] = np.quantile(np.linalg.norm(late[:, 3:6], axis=1), 0.95)
        if fault != "none":
            continue
        for when, part in (("before", rows[(rows[:, 0] > -0.05) & (rows[:, 0] < 0.0)]), ("after", late)):
            for k, axis in enumerate("xyz"):
                off = np.abs(part[:, 9 + k])
                metrics[f"{prefix}spin_{axis}_{when}_median"], metrics[f"{prefix}spin_{axis}_{when}_p95"] = (
                    np.median(off),
                    np.quantile(off, 0.95),
                )
                metrics[f"{prefix}spin_{axis}_{when}_within_2_sigma"] = np.mean(off < 2.0 * part[:, 18 + k])
    balls = [compared(seed) for seed in range(args.runs)]
    rows, nis = np.array([row for part, _ in balls for row in part]), np.concatenate([values for _, values in balls])
    metrics["nis"], metrics["nis_median"] = nis.mean(), np.median(nis)
    after = rows[(rows[:, 0] > 0.0) & (rows[:, 0] < 0.3)]
    for k, who in ((1, "tracker"), (2, "without_bounce_model")):
        for when, part in (("across", rows[(rows[:, 0] > -HORIZON) & (rows[:, 0] < 0.0)]), ("after", after)):
            metrics[f"{who}_{when}_bounce_median_m"], metrics[f"{who}_{when}_bounce_p95_m"] = (
                np.median(part[:, k]),
                np.quantile(part[:, k], 0.95),
            )
    report("tracking", args.runs, metrics, args.json)


if __name__ == "__main__":
    main()
