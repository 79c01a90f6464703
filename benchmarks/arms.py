"""Posture and joint speeds for any arm, and what the PA10's closed form is worth. scripts/bench arms

Strokes are made by joints anywhere within their limits at half of their speeds. The URDFs are those of the PyPI package
`example-robot-data`, if it is installed: pip install --no-deps example-robot-data
"""

from __future__ import annotations

import importlib.metadata
import time
import warnings
from dataclasses import replace

import numpy as np
import pinocchio as pin
from pink import Configuration, solve_ik
from pink.exceptions import PinkError
from pink.limits import ConfigurationLimit
from pink.tasks import FrameTask
from report import arguments, report
from tt_arm.model import ArmModel
from tt_arm.reach import reach
from tt_core.states import RacketState

ARMS = {
    "UR5": ("ur_description/urdf/ur5_robot.urdf", "tool0"),
    "Panda": ("panda_description/urdf/panda.urdf", "panda_link8"),
    "Kinova Jaco 2": ("kinova_description/robots/kinova.urdf", "j2s6s200_end_effector"),
}
MOUNT = (0.0, 0.0, 0.15, 0.0, 0.5 * np.pi, 0.0)  # m, rad: the racket's plane holds the axis of the tip
PEERS = 200  # targets that pin-pink is given, at most
STEPS, PEER = 100, 1e-6  # iterations of pin-pink, at most; m and rad, where they end


def arms() -> dict[str, ArmModel]:
    """The PA10 by both methods, and the arms that are installed."""
    pa10 = ArmModel.pa10()
    found = {"PA10 by its closed form": pa10, "PA10 as any arm": replace(pa10, closed_form=None)}
    try:
        files = importlib.metadata.files("example-robot-data") or []
    except importlib.metadata.PackageNotFoundError:
        print("example-robot-data is not installed: the PA10 only")
        return found
    for name, (path, tip) in ARMS.items():
        urdf = next(str(file.locate()) for file in files if file.as_posix().endswith(path))
        found[name] = ArmModel.from_urdf(urdf, tip, (-0.7, 0.7625, 0.0, 0.0), MOUNT)
    return found


def strokes(arm: ArmModel, count: int) -> list[RacketState]:
    """Rackets of random joints."""
    rng, made = np.random.default_rng(0), []
    for _ in range(count):
        q, qdot = rng.uniform(*arm.position_limits.T), 0.5 * arm.speed_limits * rng.uniform(-1.0, 1.0, len(arm.names))
        position, rotation = arm.racket(q)
        made.append(RacketState.facing(1.0, position, arm.jacobian(q)[:3] @ qdot, rotation[:, 2]))
    return made


def by_pink(arm: ArmModel, racket: RacketState) -> bool:
    """Whether pin-pink finds a posture from the waiting one, by full steps within the position limits."""
    task, limits = FrameTask("racket", 1.0, [1.0, 1.0, 0.0]), [ConfigurationLimit(arm.pinocchio)]
    at = Configuration(arm.pinocchio, arm.pinocchio.createData(), arm.waiting.copy())
    for _ in range(STEPS):
        pose = at.get_transform_frame_to_world("racket")
        if max(np.abs(racket.position - pose.translation).max(), np.linalg.norm(pose.rotation[:, 2] - racket.normal)) < PEER:
            return True
        turn = pin.Quaternion.FromTwoVectors(pose.rotation[:, 2], racket.normal)
        task.set_target(pin.SE3(turn.matrix() @ pose.rotation, racket.position))
        try:
            at.integrate_inplace(solve_ik(at, [task], 1.0, solver="daqp", limits=limits, safety_break=False), 1.0)
        except PinkError:
            return False
    return False


def main() -> None:
    given, metrics = arguments("arms", 10000), dict[str, float]()
    warnings.simplefilter("ignore")  # of pin-pink: that Newton's method oversteps a limit is counted
    for name, arm in arms().items():
        rackets, found, times = strokes(arm, given.runs), [], []
        reach(arm, rackets[0], arm.waiting)
        for racket in rackets:
            start = time.process_time()
            result = reach(arm, racket, arm.waiting)
            times.append(1e6 * (time.process_time() - start))
            found.append(result)
        metrics[f"{name}: found in all limits, %"] = 100.0 * float(np.mean([one.reason is None for one in found]))
        metrics[f"{name}: median us"] = float(np.median(times))
        metrics[f"{name}: 99 % us"] = float(np.quantile(times, 0.99))
        metrics[f"{name}: share of the speed limits, mean"] = float(np.mean([one.ratio for one in found if one.reason is None]))
        times_any, inside = [], []
        reach(arm, rackets[0], arm.waiting, method="any")
        for racket in rackets:
            start = time.process_time()
            result = reach(arm, racket, arm.waiting, method="any")
            times_any.append(1e6 * (time.process_time() - start))
            inside.append(np.isfinite(result.ratio))
        metrics[f"{name}: any posture found in position limits, %"] = 100.0 * float(np.mean(inside))
        metrics[f"{name}: any posture, median us"] = float(np.median(times_any))
        start = time.process_time()
        peers = [by_pink(arm, racket) for racket in rackets[:PEERS]]
        metrics[f"{name}: found by pin-pink, %"] = 100.0 * float(np.mean(peers))
        took = 1e6 * (time.process_time() - start) / len(peers)
        metrics[f"{name}: pin-pink takes, times any posture (means)"] = took / float(np.mean(times_any[:PEERS]))
    report("arms", given.runs, metrics, given.json)


if __name__ == "__main__":
    main()
