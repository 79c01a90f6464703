"""What following the ball and learning are worth: rallies without ROS in the world `real`, the same balls with and without each part.

--balls N plays N balls of each robot (default 1,000), and a fifth of them with each fault of the wide cameras. What is played is kept in
--cache FOLDER by revision, so an interrupted run goes on where it was. --figure FILE.svg draws the error at the strike. --nodes N plays
N balls through the real nodes (default 100), for the time from a wide camera's frame to the changed command.

Sessions have 50 balls; landing errors are those after the first ten. A ball can be reached if an oracle that knows the true path from the
launch on has a stroke for it (`tt_eval.oracle`). Errors at the strike are those of the path predicted from the last state at least so old.
Replans are strokes from newer states for a ball on its way; the arm is judged by the plant's own record: its largest share of the speed
limits, its largest acceleration (rad/s^2), its least clearance (m), and end stop hits.
"""

from __future__ import annotations

import argparse
import json
import math
import os
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import latency
import numpy as np
from feedback_figure import draw
from report import report
from tt_arm.joints import Joints
from tt_arm.model import ArmModel
from tt_core.flight import fly
from tt_core.revision import revision
from tt_eval.episode import landing_error, session
from tt_eval.oracle import reachable
from tt_eval.process_pool import process_pool
from tt_eval.scenario import Scenario, load
from tt_sim.world.arm_record import ArmRecord
from tt_sim.world.outcome import Result

SESSION, LEARNT = 50, 10  # balls of a session, and those before its landing errors count
AHEAD = (0.6, 0.4, 0.2, 0.1, 0.05)  # s before the strike
PARTS = {  # what is switched off, by the beginning of the metrics' names
    "real": {},
    "no_feedback": {"feedback": False, "learning": False},
    "no_spin": {"spin": "ignored"},
    "no_learning": {"learning": False},
    "no_margin": {"margin": 0.0},
}
FAULTS = {"lost": {"dropped": 0.3}, "outliers": {"outliers": 0.05}, "late": {"late": 0.02}, "dead_camera": {"dead": 1}}


def scenarios() -> dict[str, tuple[Scenario, float]]:
    """Return what is played by name, with the share of the balls that it is played with."""
    real = replace(load("real", robot="feedback", images=False), session=SESSION)
    played = {name: (replace(real, robot=replace(real.robot, **parts)), 1.0) for name, parts in PARTS.items()}
    by_ball = replace(load("real", robot="feedback", world="real_by_ball", images=False), session=SESSION)
    played["by_ball"] = by_ball, 1.0
    for name, faults in FAULTS.items():
        cameras = replace(real.world.tracking_cameras, **faults)
        played[name] = replace(real, world=replace(real.world, tracking_cameras=cameras)), 0.2
    return played


def strike_errors(episode):
    """Return place (m), time (s) and velocity (m/s) off at the true strike by s ahead, of the last path predicted before."""
    hit, known = episode.outcome.hit, [(response.state.time, response.path) for response in episode.responses]
    if not known and episode.measured is not None and episode.path is not None:
        known = [(episode.measured.time, episode.path)]
    errors = {}
    for ahead in AHEAD if hit is not None else ():
        paths = [path for time, path in known if time <= hit.before.time - ahead and path.times[-1] >= hit.before.time]
        if paths:
            ball, true = paths[-1].at(hit.before.time), hit.before
            off, speed = ball.position - true.position, np.linalg.norm(true.velocity)
            errors[str(ahead)] = (
                float(np.linalg.norm(off)),
                float(abs(off @ true.velocity) / speed**2),
                float(np.linalg.norm(ball.velocity - true.velocity)),
            )
    return errors


def consistency(episode):
    """Return the squared errors of the states over their covariances, per dimension (NEES)."""
    known, ratios = [episode.outcome.launched, *(contact.after for contact in episode.outcome.contacts)], []
    end = episode.outcome.hit.before.time if episode.outcome.hit else math.inf
    for state in (response.state for response in episode.responses if response.state.time < end):
        last = [ball for ball in known if ball.time <= state.time][-1]
        off = state.vector - fly(last.vector, state.time - last.time, episode.trial.physics.air.coefficients)
        ratios.append(float(off @ np.linalg.solve(state.covariance, off)) / len(off))
    return ratios


def arm_record(episode, model):
    """Return the worst that the true arm did while a ball flew."""
    n = len(model.names)
    states = [Joints(row[0], row[1 : 1 + n], row[1 + n :]) for row in episode.joints]
    record = ArmRecord(model, states[0])
    for joints in states[1:]:
        record.note(joints)
    return {"speed": record.speed[0], "acceleration": record.acceleration[0], "clearance": record.clearance[0], "hits": record.hits}


def play(name, number, balls):
    """Play one session; return a row for each ball."""
    scenario, rows = scenarios()[name][0], []
    model = ArmModel.pa10()
    for episode in session(replace(scenario, session=min(balls, SESSION)), number):
        rows.append(
            {
                "hit": episode.outcome.hit is not None,
                "landed": episode.outcome.result is Result.RETURNED,
                "off": landing_error(episode),
                "miss": str(episode.miss or ""),
                "reachable": reachable(episode.trial, model).swing is not None if name == "real" else None,
                "strike": strike_errors(episode),
                "nees": consistency(episode),
                "replans": max(0, len(episode.responses) - 1),
                "arm": arm_record(episode, model),
            }
        )
    return rows


def kept(cache, name, number, balls):
    """Return the rows of a session from the cache, or play it."""
    mark = sha256(repr((revision(), scenarios()[name][0], number, balls)).encode()).hexdigest()[:16]
    file = cache / f"{name}_{number:04d}_{mark}.json"
    if not file.is_file():
        half = file.with_suffix(".half")
        half.write_text(json.dumps(play(name, number, balls)))
        half.rename(file)
    return json.loads(file.read_text())


def of_balls(name, sessions):
    """Return the metrics of one robot and world; sessions: lists of rows."""
    rows = [row for rows in sessions for row in rows]
    late = [row["off"] for rows in sessions for row in rows[LEARNT:] if row["landed"]]
    metrics = {f"{name}_balls": len(rows)}
    for share in ("hit", "landed"):
        metrics[f"{name}_{share}_share"] = float(np.mean([row[share] for row in rows]))
    metrics[f"{name}_landing_error_median"] = float(np.median(late)) if late else math.nan
    metrics[f"{name}_landing_error_p95"] = float(np.quantile(late, 0.95)) if late else math.nan
    ratios = [ratio for row in rows for ratio in row["nees"]]
    if ratios:
        metrics[f"{name}_nees"] = float(np.mean(ratios))
    metrics[f"{name}_replans"] = sum(row["replans"] for row in rows)
    for what, worst in (("speed", max), ("acceleration", max), ("clearance", min), ("hits", max)):
        metrics[f"{name}_arm_{what}"] = worst(row["arm"][what] for row in rows)
    if name == "real":
        can = [row["hit"] for row in rows if row["reachable"]]
        metrics["reachable_share"], metrics["reachable_hit_share"] = len(can) / len(rows), float(np.mean(can))
    for kind in sorted({row["miss"] for row in rows} - {""}):
        metrics[f"{name}_missed_{kind.replace(' ', '_')}"] = sum(row["miss"] == kind for row in rows)
    return metrics


def at_strike(name, sessions):
    """Return median and 95 % of the errors at the strike by s ahead."""
    metrics = {}
    for ahead in AHEAD:
        found = [row["strike"][str(ahead)] for rows in sessions for row in rows if str(ahead) in row["strike"]]
        if not found:
            continue
        for k, what in enumerate(("place_m", "time_s", "velocity_m_s")):
            for share, label in ((0.5, "median"), (0.95, "p95")):
                metrics[f"{name}_strike_{1e3 * ahead:.0f}_ms_{what}_{label}"] = float(np.quantile([row[k] for row in found], share))
    return metrics


def main():
    parser = argparse.ArgumentParser(
        prog="scripts/bench feedback", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path, help="write the metrics here")
    parser.add_argument("--balls", type=int, default=1000, help="balls of each robot (default 1000)")
    parser.add_argument("--only", nargs="+", choices=tuple(scenarios()), help="play these only")
    parser.add_argument("--cache", type=Path, default=Path("out/feedback"), help="what was played is kept here (default %(default)s)")
    parser.add_argument("--figure", type=Path, help="draw the error at the strike here, SVG")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes (default: one for each core)")
    parser.add_argument("--nodes", type=int, default=100, help="balls through the nodes; 0: none (default %(default)s)")
    args = parser.parse_args()
    latency.check_frozen()
    args.cache.mkdir(parents=True, exist_ok=True)
    metrics = {}
    with process_pool(args.workers) as executor:
        running = {}
        for name, (_, share) in scenarios().items():
            if args.only and name not in args.only:
                continue
            count = max(1, math.ceil(share * args.balls / SESSION))
            size = min(args.balls, SESSION)
            running[name] = [executor.submit(kept, args.cache, name, number, size) for number in range(count)]
        for name, futures in running.items():
            sessions = [future.result() for future in futures]
            metrics |= of_balls(name, sessions)
            if name in ("real", "no_feedback"):
                metrics |= at_strike(name, sessions)
            print(
                name, {key: round(value, 4) for key, value in metrics.items() if key.startswith(name) and "strike" not in key}, flush=True
            )
    if args.nodes:
        rows, captured, _ = latency.run(args.nodes, track=True)
        metrics["method2_ms"] = latency.method2_ms(captured)
        metrics |= latency.of_wide_frames(latency.by_cameras(rows)[1], metrics["method2_ms"])
    report("feedback", args.balls, metrics, args.json)
    if args.figure:
        draw(metrics, args.figure)


if __name__ == "__main__":
    main()
