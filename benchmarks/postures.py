"""The posture for a racket: ours beside pin-pink, a task-space solver on pinocchio, and (4.63) in numpy. scripts/bench postures

All three find a posture for the face's position and normal, from the waiting posture, in one process, a few targets each in turn. A
peer succeeds when position and normal are within PEER of the target and the joints within their position limits.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable

import numpy as np
import pinocchio as pin
from pink import Configuration, solve_ik
from pink.exceptions import PinkError
from pink.limits import ConfigurationLimit
from pink.tasks import FrameTask
from report import arguments, report
from tt_arm.control import warm
from tt_arm.model import ArmModel
from tt_arm.reach import reach
from tt_core.states import RacketState

MODEL = ArmModel.pa10()
FRAME = MODEL.pinocchio.getFrameId("racket")
PEER = 1e-6  # m and rad, where the peers' iterations end; ours ends at 1e-9
STEPS = 100  # iterations of a peer, at most
SEEN = 0.05  # m, from the waiting posture to a target near it
TURN = 20  # targets in turn, so that each solver runs warm
PEERS = 300  # targets that the peers are given, at most


def known(rng: np.random.Generator) -> RacketState:
    """The racket of a posture within 0.8 of all limits, before the arm."""
    while True:
        q = rng.uniform(-0.8, 0.8, 7) * MODEL.position_limits[:, 1]
        position, rotation = MODEL.racket(q)
        if -0.4 < position[0] < 0.3 and -0.1 < position[1] < 1.6 and 0.1 < position[2] < 0.7:
            qdot = rng.uniform(-0.5, 0.5, 7) * MODEL.speed_limits
            return RacketState.facing(1.0, position, MODEL.jacobian(q)[:3] @ qdot, rotation[:, 2])


def near(rng: np.random.Generator) -> RacketState:
    """A racket near that of the waiting posture, facing as it does."""
    position, rotation = MODEL.racket(MODEL.waiting)
    return RacketState.facing(1.0, position + rng.uniform(-SEEN, SEEN, 3), rng.uniform(-0.5, 0.5, 3), rotation[:, 2])


def by_numpy(racket: RacketState) -> np.ndarray | None:
    """(7,) by (4.63), Newton's method with the pseudo-inverse on pinocchio's Jacobian."""
    q, data = MODEL.waiting.copy(), MODEL.pinocchio.createData()
    for _ in range(STEPS):
        jacobian = pin.computeFrameJacobian(MODEL.pinocchio, data, q, FRAME, pin.LOCAL_WORLD_ALIGNED)
        pose = data.oMf[FRAME]
        across = pose.rotation[:, :2].T
        error = np.append(racket.position - pose.translation, across @ np.cross(pose.rotation[:, 2], racket.normal))
        if np.abs(error).max() < PEER:
            return q
        q = q + np.linalg.pinv(np.vstack([jacobian[:3], across @ jacobian[3:]])) @ error
    return None


def by_pink(racket: RacketState) -> np.ndarray | None:
    """(7,) by full steps of pin-pink within the position limits; the turn about the normal costs nothing and is asked to stay."""
    task, limits = FrameTask("racket", 1.0, [1.0, 1.0, 0.0]), [ConfigurationLimit(MODEL.pinocchio)]
    at = Configuration(MODEL.pinocchio, MODEL.pinocchio.createData(), MODEL.waiting)
    for _ in range(STEPS):
        pose = at.get_transform_frame_to_world("racket")
        turn = pin.Quaternion.FromTwoVectors(pose.rotation[:, 2], racket.normal)
        if max(np.abs(racket.position - pose.translation).max(), np.linalg.norm(pose.rotation[:, 2] - racket.normal)) < PEER:
            return at.q
        task.set_target(pin.SE3(turn.matrix() @ pose.rotation, racket.position))
        try:
            at.integrate_inplace(solve_ik(at, [task], 1.0, solver="daqp", limits=limits, safety_break=False), 1.0)
        except PinkError:
            return None
    return None


def ours(method: str) -> Callable[[RacketState], np.ndarray | None]:
    def solved(racket: RacketState) -> np.ndarray | None:
        found = reach(MODEL, racket, MODEL.waiting, method=method)
        return found.q if np.isfinite(found.ratio) else None

    return solved


def beside(rackets: list[RacketState], solvers: dict[str, Callable[[RacketState], np.ndarray | None]], where: str) -> dict[str, float]:
    """Success (%) and median time (us) of each, and how many times longer than the first it takes."""
    took, inside = ({name: [] for name in solvers} for _ in range(2))
    for some in (rackets[k : k + TURN] for k in range(0, len(rackets), TURN)):
        for name, solve in solvers.items():
            for racket in some:
                start = time.perf_counter()
                q = solve(racket)
                took[name].append(1e6 * (time.perf_counter() - start))
                inside[name].append(q is not None and bool(np.all(np.abs(q) <= MODEL.position_limits[:, 1] + PEER)))
    metrics, first = dict[str, float](), next(iter(solvers))
    for name in solvers:
        metrics[f"{where}: reached in position limits, {name}, %"] = 100.0 * float(np.mean(inside[name]))
        metrics[f"{where}: {name}, median us"] = float(np.median(took[name]))
        if name != first:
            metrics[f"{where}: {name} takes, times {first}"] = float(np.median(np.array(took[name]) / np.array(took[first])))
    return metrics


def figures(runs: int) -> dict[str, float]:
    """`runs` reachable rackets by ours, the first PEERS of them by all, and as many near the waiting posture."""
    rng, metrics, peers = np.random.default_rng(0), dict[str, float](), {"pin-pink": by_pink, "(4.63) in numpy": by_numpy}
    warnings.simplefilter("ignore")  # of pin-pink: that Newton's method oversteps a limit is counted
    rackets = [known(rng) for _ in range(runs)]
    for method in ("best", "near", "liu"):
        found, times = [], []
        for racket in rackets:
            start = time.perf_counter()
            found.append(reach(MODEL, racket, MODEL.waiting, method=method).reason is None)
            times.append(1e6 * (time.perf_counter() - start))
        metrics[f"reachable rackets in all limits, {method}, %"] = 100.0 * float(np.mean(found))
        metrics[f"reachable rackets, {method}, median us"] = float(np.median(times))
        metrics[f"reachable rackets, {method}, 99 % us"] = float(np.quantile(times, 0.99))
    metrics |= beside(rackets[:PEERS], {"best": ours("best"), **peers}, "anywhere")
    return metrics | beside([near(rng) for _ in range(min(runs, PEERS))], {"near": ours("near"), **peers}, "near waiting")


def main() -> None:
    given = arguments("postures", 10000)
    warm(MODEL)
    report("postures", given.runs, figures(given.runs), given.json)


if __name__ == "__main__":
    main()
