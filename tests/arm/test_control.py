"""The whole arm without ROS: strokes in, and the simulated racket is there."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from arm.printed import NAMES, printed
from tt_arm.choice import ChoiceParams, choose
from tt_arm.control import ArmControl, ControlParams
from tt_arm.model import ArmModel
from tt_arm.reach import ReachParams, reach
from tt_arm.servo import ServoParams, follow
from tt_arm.swing import Joints, SwingLimits, plan
from tt_core.states import RacketState
from tt_sim.plant import Plant, PlantParams

MODEL, TICK = ArmModel.pa10(), 0.002
HELD = Joints(0.0, MODEL.waiting, np.zeros(7))


class Arm:
    """Control and plant, tick by tick."""

    def __init__(self, plant=None, **given):
        self.control, self.plant, self.joints = ArmControl(MODEL, **given), Plant(MODEL, plant), HELD
        self.rng, self.begun, self.reasons, self.command = np.random.default_rng(0), [], set(), np.zeros(7)
        self.control.enable(True)

    def run(self, until, at=None):
        """Until the time `until` (s); the true racket at the time `at`."""
        racket = None
        while self.joints.time < until - 1e-9:
            step = self.control.step(self.plant.measured(self.joints, self.rng))
            self.begun += [step.begun] if step.begun else []
            self.reasons.add(step.reason)
            if at is not None and self.joints.time <= at < self.joints.time + TICK:
                racket = self.plant.racket(self.joints, step.command, at - self.joints.time)
            self.command = step.command
            self.joints = self.plant.advance(self.joints, step.command, TICK)
        return racket


def missed(there, racket):
    """mm, degrees, m/s."""
    angle = np.degrees(np.arccos(min(1.0, there.rotation[:, 2] @ racket.normal)))
    return 1e3 * np.linalg.norm(there.position - racket.position), angle, np.linalg.norm(there.velocity - racket.velocity)


@pytest.mark.parametrize("racket", printed(0.5), ids=NAMES)
def test_the_racket_is_there(racket):
    arm = Arm()
    arm.run(0.05)
    assert arm.control.take([racket]).index == 0
    position, angle, speed = missed(arm.run(2.5, racket.time), racket)
    # on the day 0.11 mm, 0.01 degrees, 0.006 m/s with a plant that lags by 5 ms
    assert position < 0.5
    assert angle < 0.05
    assert speed < 0.03
    assert arm.joints.q == pytest.approx(MODEL.waiting, abs=1e-3)
    assert arm.reasons == {None}  # the guard had nothing to cut
    assert len(arm.begun) == 1


def test_a_slower_plant_with_noise_is_still_followed():
    racket, arm = printed(0.5)[3], Arm(PlantParams(time_constant=0.010, q_noise=1e-4))
    arm.run(0.05)
    arm.control.take([racket])
    # the lead is 5 ms short of this plant: 5 ms x 2 m/s = 10 mm without feedback
    assert missed(arm.run(1.0, racket.time), racket)[0] < 6.0


def test_newer_strokes_bend_the_swing():
    first = printed(0.55)[0]
    newer = RacketState(0.553, first.position + [0.01, -0.01, 0.005], first.velocity * 1.02, first.alpha, first.beta + 0.02)
    arm = Arm()
    arm.run(0.05)
    arm.control.take([first])
    arm.run(0.3)
    assert arm.control.take([first]).reasons == ("the swing on its way will do",)
    assert arm.control.take([newer]).index == 0
    assert missed(arm.run(0.6, newer.time), newer)[0] < 0.5
    assert arm.reasons == {None}

    arm = Arm(params=ControlParams(replan=False))
    arm.run(0.05)
    arm.control.take([first])
    arm.run(0.3)
    assert arm.control.take([newer]).reasons == ("a swing is on its way",)


def test_a_ball_does_not_cost_the_one_before():
    """Strokes of the next ball that come before the strike begin after it, even when they change."""
    first, second = printed(0.55)[0], printed(1.35)[1]
    moved = RacketState(second.time, second.position + 0.01, second.velocity, second.alpha, second.beta)
    arm = Arm()
    arm.run(0.05)
    assert arm.control.take([first]).index == 0
    arm.run(0.4)
    assert arm.control.take([second]).swing.start.time == first.time
    arm.run(0.45)
    assert arm.control.take([moved]).swing.start.time == first.time
    assert missed(arm.run(0.6, first.time), first)[0] < 0.5
    assert missed(arm.run(1.5, moved.time), moved)[0] < 0.5
    assert arm.reasons == {None}


def test_the_first_candidate_that_can_be_made_is_taken():
    good, arm = printed(0.5)[1], Arm()
    far = RacketState(0.5, np.array([1.5, 0.7, 0.3]), np.zeros(3), 0.0, 1.2)
    soon = RacketState(0.1, good.position, good.velocity, good.alpha, good.beta)
    arm.run(0.05)
    choice = arm.control.take([far, soon, good, good])
    assert choice.index == 2
    assert choice.reasons[0] == "0: out of reach"
    assert choice.reasons[1].startswith("1: the strike is ")
    assert arm.control.take([]).index is None


def test_the_first_is_taken_even_with_nothing_to_spare():
    """A later candidate with more time is no better: their order is the racket's."""
    start, limits = Joints(0.0, MODEL.waiting, np.zeros(7)), SwingLimits()
    racket, relaxed = printed(0.0)[1], printed(1.0)[1]
    earliest = plan(MODEL, start, reach(MODEL, racket, MODEL.waiting), racket.time, limits).earliest
    hasty = RacketState(earliest + 0.002, racket.position, racket.velocity, racket.alpha, racket.beta)
    choice = choose(MODEL, [hasty, relaxed], start, limits, ReachParams(), ChoiceParams())
    assert choice.index == 0
    assert choice.swing.earliest <= hasty.time


def test_with_the_next_ball_at_once_the_arm_takes_what_has_it_back_soonest():
    def taken(hurry, balls):
        arm = Arm(params=ControlParams(hurry=hurry))
        arm.run(0.05)
        return [arm.control.take(rackets) for rackets in balls]

    first, second = printed(0.5)[:1], [printed(1.1)[i] for i in (4, 0, 1, 2, 3)]
    assert [choice.index for choice in taken(0.0, (first, second))] == [0, 0]
    assert [choice.index for choice in taken(0.5, (first, second))] == [0, 0]  # 0.6 s apart
    alone = [taken(0.0, (first, [racket]))[1].swing.end_time for racket in second]
    hurried = taken(1.0, (first, second))[1]
    assert hurried.swing.end_time == min(alone) < alone[0]


def test_why_each_candidate_failed_is_told():
    far = RacketState(0.5, np.array([1.5, 0.7, 0.3]), np.zeros(3), 0.0, 1.2)
    soon, low = printed(0.1)[0], RacketState(2.0, np.array([0.05, 0.7, 0.06]), np.array([0.3, 0.0, 0.3]), 0.0, 1.4)
    candidates = [far, soon, low, far, far]
    choice = choose(MODEL, candidates, Joints(0.0, MODEL.waiting, np.zeros(7)), SwingLimits(), ReachParams(), ChoiceParams(tries=3))
    assert choice.index is None
    for told, words in zip(
        choice.reasons, ("0: out of reach", "1: the strike is", "2: the arm would come within", "3 to 4: not tried"), strict=True
    ):
        assert told.startswith(words)


def test_nothing_moves_unless_enabled():
    arm = Arm()
    arm.control.enable(False)
    arm.run(0.1)
    assert arm.control.take(printed(0.6)[:1]).reasons == ("not enabled",)
    arm.run(0.8)
    assert np.array_equal(arm.joints.q, MODEL.waiting)


def test_off_the_path_it_begins_anew_and_on_failure_it_stops():
    arm = Arm()
    arm.joints = Joints(0.0, MODEL.waiting + 0.3, np.zeros(7))
    arm.run(1.5)
    assert arm.joints.q == pytest.approx(MODEL.waiting, abs=1e-3)
    arm.control.take(printed(2.0)[:1])
    arm.run(1.8)
    assert np.abs(arm.joints.qdot).max() > 0.1
    assert np.all(arm.control.fail("a test") == 0.0)
    arm.run(2.2)
    assert np.all(np.abs(arm.joints.qdot) < 1e-9)
    assert arm.reasons >= {"a test"}


def test_silence_stops_the_arm_and_it_goes_on_afterwards():
    racket, arm = printed(0.5)[1], Arm()
    assert arm.control.watch(1.0) is None  # nothing was ever heard
    arm.run(0.05)
    arm.control.take([racket])
    arm.run(0.3)
    assert arm.control.watch(0.34) is None
    assert arm.control.watch(0.36) is None  # this may be our own fault
    for _ in range(3):
        arm.joints = arm.plant.advance(arm.joints, arm.control.watch(arm.joints.time + 0.06), 0.06)
    assert np.abs(arm.joints.qdot).max() < 1e-6
    arm.run(2.5)
    assert arm.joints.q == pytest.approx(MODEL.waiting, abs=1e-3)


@pytest.mark.parametrize("hold", [0.07, 0.09, 0.12, 0.2])
@pytest.mark.parametrize("begin", [0.2, 0.35, 0.45, 0.6])
def test_after_a_pause_of_the_joint_states_the_arm_goes_on(begin, hold):
    """The swing that the stop has spoilt is given up: to chase it would be cut for so long that the guard latches."""
    arm = Arm()
    arm.run(0.05)
    arm.control.take([printed(0.5)[0]])
    arm.run(begin)
    for i in range(round(hold / TICK)):
        if i % 10 == 9:  # as the node's timer looks, each 20 ms
            stop = arm.control.watch(arm.joints.time)
            arm.command = arm.command if stop is None else stop
        arm.joints = arm.plant.advance(arm.joints, arm.command, TICK)
    arm.run(arm.joints.time + 0.3)
    assert arm.control.guard.latched is None
    time = arm.joints.time + 0.6
    assert arm.control.take([printed(time)[0]]).index == 0
    position, _, _ = missed(arm.run(time + 1.5, time), printed(time)[0])
    assert position < 0.5  # mm, as without the pause


def test_an_old_joint_state_stops_the_arm_too():
    arm = Arm()
    arm.run(0.05)
    assert arm.control.step(arm.joints, arm.joints.time + 0.15).reason is None
    assert arm.control.step(arm.joints, arm.joints.time + 0.22).reason is None  # this may be our own fault
    assert arm.control.step(arm.joints, arm.joints.time + 0.22).reason == "joint state is 0.220 s old"


def test_a_strike_far_ahead_is_refused():
    arm = Arm()
    arm.run(0.05)
    assert arm.control.take(printed(8.0)).reasons == ("the strike is 7.95 s ahead",)


def test_the_last_commands_are_a_stop():
    arm = Arm()
    arm.run(0.05)
    arm.control.take(printed(0.5)[:1])
    arm.run(0.48)
    moving = np.abs(arm.joints.qdot).max()
    assert moving > 0.5
    commands = np.array(arm.control.ending(TICK))
    assert np.all(commands[-1] == 0.0)
    assert np.abs(np.diff(commands, axis=0)).max() <= 40.0 * TICK + 1e-9
    assert len(commands) * 40.0 * TICK == pytest.approx(moving, rel=0.2)


def test_the_servo_pulls_towards_the_path():
    rest, limits = plan(MODEL, HELD, None, 0.0), MODEL.speed_limits
    assert np.all(follow(rest, 1.0, MODEL.waiting, limits, ServoParams()) == 0.0)
    assert follow(rest, 1.0, MODEL.waiting - 0.01, limits, ServoParams(gain=15.0)) == pytest.approx(np.full(7, 0.15))
    assert follow(rest, 1.0, MODEL.waiting + 9.0, limits, ServoParams()) == pytest.approx(-limits)


def test_nothing_is_left_to_compile_once_warm():
    """In a process of its own, for here the other tests have compiled; a kernel that is loaded while a ball flies costs 0.1 s."""
    script = """
import importlib, pkgutil, tt_arm
from numba.core.dispatcher import Dispatcher
from arm.printed import printed
from arm.test_control import MODEL, Arm
from tt_arm.control import warm

def kernels():
    modules = [importlib.import_module(f"tt_arm.{m.name}") for m in pkgutil.iter_modules(tt_arm.__path__) if not m.name.endswith("_node")]
    return {(v.__module__, k, str(s)) for m in modules for k, v in vars(m).items() if isinstance(v, Dispatcher) for s in v.signatures}

warm(MODEL)
before, arm = kernels(), Arm()
arm.run(0.05)
arm.control.take(printed(0.5)[:1])
arm.run(0.7)
arm.control.take([*printed(1.3), *printed(0.75)])
arm.run(2.0)
print(sorted(kernels() - before))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=Path(__file__).parents[1])
    assert done.stdout.strip() == "[]"
