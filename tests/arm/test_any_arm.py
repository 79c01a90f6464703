"""Reach and plan are one method for all arms: strokes that an arm can make are found, and its swings keep its limits."""

import importlib.metadata
from dataclasses import replace

import numpy as np
import pytest
from arm.own_urdfs import ARMS
from tt_arm.joints import Joints
from tt_arm.model import ArmModel
from tt_arm.reach import ReachFailure, adjust, reach
from tt_arm.safety.clearance import clearance
from tt_arm.safety.guard import Guard
from tt_arm.swing import plan
from tt_core.errors import BadShape
from tt_core.states import RacketState

BASES = {"five": (-0.5, 0.76, 0.0, 0.0), "six": (-0.7, 0.7, 0.1, 0.3), "eight": (-0.6, 0.76, -0.1, 0.0), "gantry": (-0.4, 0.76, 0.1, 0.0)}
FOREIGN = {  # path of the PyPI package, tip, mount
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "tool0", (0.0, 0.0, 0.15, 0.0, 1.5708, 0.0)),
    "panda": ("panda_description/urdf/panda.urdf", "panda_link8", (0.0, 0.0, 0.15, 0.0, 1.5708, 0.0)),
    "kinova": ("kinova_description/robots/kinova.urdf", "j2s6s200_end_effector", (0.0, 0.0, 0.15, 0.0, 1.5708, 0.0)),
}


@pytest.fixture(scope="module", params=[*ARMS, *FOREIGN])
def arm(request, tmp_path_factory):
    if request.param in FOREIGN:
        try:
            files = importlib.metadata.files("example-robot-data") or []
        except importlib.metadata.PackageNotFoundError:
            pytest.skip("example-robot-data is not installed: pip install --no-deps example-robot-data")
        path, tip, mount = FOREIGN[request.param]
        return ArmModel.from_urdf(next(f.locate() for f in files if f.as_posix().endswith(path)), tip, (-0.7, 0.76, 0.0, 0.0), mount)
    text, tip, mount, _ = ARMS[request.param]
    path = tmp_path_factory.mktemp("arm") / "arm.urdf"
    path.write_text(text)
    return ArmModel.from_urdf(path, tip, BASES[request.param], mount)


def strokes(arm, count, seed=0):
    """Rackets of random joints within 0.9 of the ranges at 0.5 of the speeds."""
    rng, (low, high) = np.random.default_rng(seed), arm.position_limits.T
    for _ in range(count):
        q = 0.5 * (low + high) + 0.45 * (high - low) * rng.uniform(-1.0, 1.0, len(low))
        qdot = 0.5 * arm.speed_limits * rng.uniform(-1.0, 1.0, len(low))
        position, rotation = arm.racket(q)
        yield RacketState.facing(1.0, position, arm.jacobian(q)[:3] @ qdot, rotation[:, 2])


def test_strokes_of_random_joints_are_found(arm):
    missed, tried = [], 300
    for racket in strokes(arm, tried):
        found = reach(arm, racket, arm.waiting)
        if found.reason is not None:
            missed.append(found.reason)
            continue
        position, rotation = arm.racket(found.q)
        assert position == pytest.approx(racket.position, abs=2e-9)
        assert rotation[:, 2] == pytest.approx(racket.normal, abs=2e-9)
        assert arm.jacobian(found.q)[:3] @ found.qdot == pytest.approx(racket.velocity, abs=1e-5)
        assert found.ratio == pytest.approx(np.abs(found.qdot / arm.speed_limits).max()) and found.ratio <= 1.0
        assert np.all(found.q >= arm.position_limits[:, 0]) and np.all(found.q <= arm.position_limits[:, 1])
    assert len(missed) <= 0.01 * tried, missed


def test_any_posture_is_within_the_limits(arm):
    missed, tried = 0, 300
    for racket in strokes(arm, tried, seed=1):
        found = reach(arm, racket, arm.waiting, method="any")
        if found.reason is not None and found.reason.code is not ReachFailure.BEYOND_SPEED_LIMIT:
            missed += 1
            continue
        position, rotation = arm.racket(found.q)
        assert position == pytest.approx(racket.position, abs=2e-9)
        assert rotation[:, 2] == pytest.approx(racket.normal, abs=2e-9)
        assert np.all(found.q >= arm.position_limits[:, 0]) and np.all(found.q <= arm.position_limits[:, 1])
    assert missed <= 0.005 * tried


def test_a_stroke_that_has_changed_a_little_is_adjusted(arm):
    racket = next(strokes(arm, 1, seed=4))
    found = reach(arm, racket, arm.waiting)
    moved = RacketState.facing(1.0, racket.position, 1.02 * racket.velocity, racket.normal)
    adjusted = adjust(arm, moved, found)
    assert adjusted.q == pytest.approx(found.q, abs=1e-6)
    assert arm.jacobian(adjusted.q)[:3] @ adjusted.qdot == pytest.approx(moved.velocity, abs=1e-6)


def test_swings_strike_on_time_within_the_limits(arm):
    """From a posture that is clear of everything to strokes nearby that are clear too."""
    rng, (low, high) = np.random.default_rng(3), arm.position_limits.T
    postures = (0.5 * (low + high) + 0.25 * (high - low) * rng.uniform(-1.0, 1.0, len(low)) for _ in range(1000))
    waiting = next(q for q in postures if clearance(q, arm.bodies)[0] > 0.03)
    arm, made, tried = replace(arm, waiting=waiting), 0, 0
    while tried < 30:
        q = waiting + 0.1 * (high - low) * rng.uniform(-1.0, 1.0, len(low))
        if clearance(q, arm.bodies)[0] < 0.03:
            continue
        tried += 1
        position, rotation = arm.racket(q)
        velocity = arm.jacobian(q)[:3] @ (0.2 * arm.speed_limits * rng.uniform(-1.0, 1.0, len(low)))
        at = max(1.0, 2.0 * float(np.max(np.abs(q - waiting) / arm.speed_limits)))  # s; a slow arm needs longer
        target = reach(arm, RacketState.facing(at, position, velocity, rotation[:, 2]), waiting)
        swing = plan(arm, Joints.at_rest(0.0, waiting), target, at)
        if swing.reason is not None:
            continue
        made += 1
        reached, speeds = swing.sample(at)
        assert reached == pytest.approx(target.q, abs=1e-6)
        assert speeds == pytest.approx(target.qdot, abs=1e-5)
        _, positions, speeds = swing.table(0.01)
        assert np.all(positions >= low) and np.all(positions <= high)
        assert np.all(np.abs(speeds) <= arm.speed_limits * (1.0 + 1e-6))
        assert positions[-1] == pytest.approx(waiting, abs=1e-6)
        assert min(clearance(row, arm.bodies)[0] for row in positions) > 0.0
    assert made >= 0.5 * tried  # others would run into something while a command is held; on the day all but a few are made


def test_the_guard_stops_any_arm_before_its_limits(arm):
    guard, q, n = Guard(arm), arm.waiting.copy(), len(arm.names)
    for k in range(2000):  # 4 s at full speed towards the upper limits
        time = 0.002 * k
        command, _ = guard.check(Joints(time, q, guard.last), arm.speed_limits.copy(), time)
        q = q + 0.002 * command
        assert np.all(q <= arm.position_limits[:, 1])
    assert command == pytest.approx(np.zeros(n), abs=0.05)  # rad/s or m/s


def test_joints_of_another_arm_are_refused(arm):
    n = len(arm.names)
    with pytest.raises(BadShape):
        reach(arm, next(strokes(arm, 1)), np.zeros(n + 1))
    with pytest.raises(BadShape):
        plan(arm, Joints.at_rest(0.0, np.zeros(n - 1)), None, 1.0)
