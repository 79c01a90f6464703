"""The whole arm without ROS: strokes in, and the simulated racket is there."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from arm.dissertation_strokes import NAMES, printed
from tt_arm.control import ArmControl, ControlParams
from tt_arm.joints import Joints
from tt_arm.model import ArmModel
from tt_arm.reach import ReachFailure, ReachParams, reach
from tt_arm.safety.guard import GuardParams
from tt_arm.safety.stops import ArmStop
from tt_arm.servo import ServoParams, follow
from tt_arm.stroke_selection import Refusal, SelectionFailure, SelectionParams, select_stroke
from tt_arm.swing import SwingFailure, SwingLimits, plan
from tt_core.errors import OutOfRange
from tt_core.failures import Failure
from tt_core.states import RacketState
from tt_sim.world.plant import Plant, PlantParams

MODEL, TICK, BRAKING = ArmModel.pa10(), 0.002, SwingLimits().acceleration
HELD = Joints(0.0, MODEL.waiting, np.zeros(7))


class Arm:
    """Control and plant, tick by tick."""

    def __init__(self, plant=None, **given):
        self.control, self.plant, self.joints = ArmControl(MODEL, **given), Plant(MODEL, plant), HELD
        self.rng, self.begun, self.codes, self.command = np.random.default_rng(0), [], set(), np.zeros(7)
        self.control.enable(True)

    def run(self, until, at=None):
        """Until the time `until` (s); the true racket at the time `at`."""
        racket = None
        while self.joints.time < until - 1e-9:
            step = self.control.step(self.plant.measured(self.joints, self.rng))
            self.begun += [step.begun] if step.begun else []
            self.codes.add(step.reason.code if step.reason else None)
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
    assert arm.codes == {None}  # the guard had nothing to cut
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
    assert arm.control.take([first]).refused.code is ArmStop.SWING_WILL_DO
    assert arm.control.take([newer]).index == 0
    assert missed(arm.run(0.6, newer.time), newer)[0] < 0.5
    assert arm.codes == {None}

    arm = Arm(params=ControlParams(replan=False))
    arm.run(0.05)
    arm.control.take([first])
    arm.run(0.3)
    assert arm.control.take([newer]).refused.code is ArmStop.SWING_ON_ITS_WAY


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
    assert arm.codes == {None}


def test_the_first_candidate_that_can_be_made_is_taken():
    good, arm = printed(0.5)[1], Arm()
    far = RacketState(0.5, np.array([1.5, 0.7, 0.3]), np.zeros(3), 0.0, 1.2)
    soon = RacketState(0.1, good.position, good.velocity, good.alpha, good.beta)
    arm.run(0.05)
    selection = arm.control.take([far, soon, good, good])
    assert selection.index == 2
    assert selection.reasons[0] == Refusal(Failure(ReachFailure.OUT_OF_REACH), 0)
    assert (selection.reasons[1].index, selection.reasons[1].failure.code) == (1, SwingFailure.TOO_SOON)
    assert arm.control.take([]).index is None


def test_the_first_is_taken_even_with_nothing_to_spare():
    """A later candidate with more time is no better: their order is the racket's."""
    start, limits = Joints(0.0, MODEL.waiting, np.zeros(7)), SwingLimits()
    racket, relaxed = printed(0.0)[1], printed(1.0)[1]
    earliest = plan(MODEL, start, reach(MODEL, racket, MODEL.waiting), racket.time, limits).earliest
    hasty = RacketState(earliest + 0.002, racket.position, racket.velocity, racket.alpha, racket.beta)
    selection = select_stroke(MODEL, [hasty, relaxed], start, limits, ReachParams(), SelectionParams())
    assert selection.index == 0
    assert selection.swing.earliest <= hasty.time


def test_with_the_next_ball_at_once_the_arm_takes_what_has_it_back_soonest():
    def taken(hurry, balls):
        arm = Arm(params=ControlParams(hurry=hurry))
        arm.run(0.05)
        return [arm.control.take(rackets) for rackets in balls]

    first, second = printed(0.5)[:1], [printed(1.1)[i] for i in (4, 0, 1, 2, 3)]
    assert [selection.index for selection in taken(0.0, (first, second))] == [0, 0]
    assert [selection.index for selection in taken(0.5, (first, second))] == [0, 0]  # 0.6 s apart
    alone = [taken(0.0, (first, [racket]))[1].swing.end_time for racket in second]
    hurried = taken(1.0, (first, second))[1]
    assert hurried.swing.end_time == min(alone) < alone[0]


def test_why_each_candidate_failed_is_told():
    far = RacketState(0.5, np.array([1.5, 0.7, 0.3]), np.zeros(3), 0.0, 1.2)
    soon, low = printed(0.1)[0], RacketState(2.0, np.array([0.05, 0.7, 0.06]), np.array([0.3, 0.0, 0.3]), 0.0, 1.4)
    candidates = [far, soon, low, far, far]
    selection = select_stroke(
        MODEL, candidates, Joints(0.0, MODEL.waiting, np.zeros(7)), SwingLimits(), ReachParams(), SelectionParams(tries=3)
    )
    assert selection.index is None
    refused = [(refusal.index, refusal.failure.code) for refusal in selection.reasons]
    codes = ReachFailure.OUT_OF_REACH, SwingFailure.TOO_SOON, SwingFailure.CLEARANCE, SelectionFailure.NOT_TRIED
    assert refused == list(zip((0, 1, 2, None), codes, strict=True))
    assert selection.reasons[3].failure.values == {"first": 3, "last": 4}


def test_nothing_moves_unless_enabled():
    arm = Arm()
    arm.control.enable(False)
    arm.run(0.1)
    assert arm.control.take(printed(0.6)[:1]).refused.code is ArmStop.NOT_ENABLED
    arm.run(0.8)
    assert np.array_equal(arm.joints.q, MODEL.waiting)


def test_off_the_path_it_begins_anew_and_on_failure_it_stops():
    arm = Arm()
    arm.joints = Joints(0.0, MODEL.waiting + 0.3, np.zeros(7))
    arm.run(4.0)
    assert arm.joints.q == pytest.approx(MODEL.waiting, abs=1e-3)
    arm.control.take(printed(4.5)[:1])
    arm.run(4.3)
    assert np.abs(arm.joints.qdot).max() > 0.1
    arm.command = arm.control.fail(RuntimeError("a test"), arm.joints.time)
    arm.run(4.7)
    assert np.all(np.abs(arm.joints.qdot) < 1e-9)
    assert ArmStop.INTERNAL in arm.codes


def moving(until=0.45):
    """An arm in the middle of a swing."""
    arm = Arm()
    arm.run(0.05)
    arm.control.take([printed(0.5)[0]])
    arm.run(until)
    assert np.abs(arm.joints.qdot).max() > 0.5
    return arm


def rests(arm, step, seconds=0.5):
    """Whether commands of step(joints, now) bring the arm to rest within the braking limit, beginning with the first of them."""
    before, commands = arm.command, []
    for _ in range(round(seconds / TICK)):
        commands.append(step(arm.joints, arm.joints.time).command)
        arm.joints = arm.plant.advance(arm.joints, commands[-1], TICK)
    changes = np.diff([before, *commands], axis=0)
    assert np.abs(changes).max() <= BRAKING * TICK + 1e-9
    assert np.abs(commands[0]).max() < np.abs(before).max()  # at once
    assert np.all(np.abs(arm.joints.qdot) < 1e-6)
    return True


BROKEN = {  # joint states that must not be used, made from a good one and the arm's clock
    ArmStop.NOT_NEWER: lambda good, first: Joints(first.time, good.q, good.qdot),
    ArmStop.AHEAD: lambda good, first: Joints(good.time + 10.0, good.q, good.qdot),
    ArmStop.OLD: lambda good, first: Joints(good.time - 10.0, good.q, good.qdot),
    ArmStop.NO_POSTURE: lambda good, first: Joints(good.time, np.full(7, 1e17), good.qdot),
    ArmStop.NO_SPEED: lambda good, first: Joints(good.time, good.q, np.full(7, -1e17)),
    ArmStop.JUMP: lambda good, first: Joints(good.time, good.q + 0.5, good.qdot),
}


@pytest.mark.parametrize("code", BROKEN)
def test_a_joint_state_that_cannot_be_used_stops_the_arm_at_once_and_play_goes_on(code):
    arm = moving()
    first, codes = arm.joints, []

    def broken(joints, now):
        step = arm.control.step(BROKEN[code](joints, first), now, joints.time)
        codes.append(step.reason.code)
        # silence is noticed beside, as by the node's timer, whatever comes
        return arm.control.watch(now) or step

    assert arm.control.step(arm.joints, arm.joints.time, arm.joints.time).reason is None
    arm.command = arm.control.guard.last
    arm.joints = arm.plant.advance(arm.joints, arm.command, TICK)
    assert rests(arm, broken)
    assert codes[0] is code
    assert arm.control.guard.latched is None
    arm.run(arm.joints.time + 4.0)  # after a jump that lasted the way home is slow
    time = arm.joints.time + 0.6
    assert arm.control.take([printed(time)[0]]).index == 0
    assert missed(arm.run(time + 1.5, time), printed(time)[0])[0] < 0.5  # mm, as without the fault


def test_a_clock_that_went_back_is_followed_from_where_the_arm_is():
    arm = moving()
    arm.control.step(arm.joints, arm.joints.time, arm.joints.time)
    back = Joints(arm.joints.time - 100.0, arm.joints.q, arm.joints.qdot)
    step = arm.control.step(back, arm.joints.time + TICK, back.time)
    assert step.reason is None
    assert step.interrupted
    assert arm.control.stroke is None
    arm.joints, arm.command = Joints(back.time, back.q, back.qdot), step.command
    arm.run(arm.joints.time + 2.0)
    assert arm.joints.q == pytest.approx(MODEL.waiting, abs=1e-3)
    time = arm.joints.time + 0.6
    assert arm.control.take([printed(time)[0]]).index == 0


def test_silence_stops_the_arm_and_it_goes_on_afterwards():
    arm = Arm()
    assert arm.control.watch(1.0) is None  # nothing was ever heard
    arm = moving()
    last = arm.joints.time - TICK
    assert arm.control.watch(last + 0.019) is None
    step = arm.control.watch(last + 0.021)
    assert step.reason.code is ArmStop.SILENT
    assert arm.control.take([printed(1.5)[0]]).index is None  # where the arm is is not known
    arm.joints, arm.command = arm.plant.advance(arm.joints, arm.command, 0.021), step.command
    assert rests(arm, lambda joints, now: arm.control.watch(now))
    arm.run(arm.joints.time + 2.5)
    assert arm.joints.q == pytest.approx(MODEL.waiting, abs=1e-3)


def test_slow_joint_states_may_be_silent_for_three_periods():
    control = ArmControl(MODEL)
    control.enable(True)
    for k in range(20):
        control.step(Joints(0.02 * k, MODEL.waiting, np.zeros(7)))
    assert control.watch(0.38 + 0.059) is None
    assert control.watch(0.38 + 0.061).reason.code is ArmStop.SILENT


@pytest.mark.parametrize("hold", [0.03, 0.07, 0.09, 0.12, 0.2, 0.5])
@pytest.mark.parametrize("begin", [0.2, 0.35, 0.45, 0.6])
def test_after_a_stall_of_the_process_the_arm_goes_on(begin, hold):
    """The drive goes on with the last command, and stops by itself after 0.1 s; then the node wakes and plans from what is measured."""
    arm = Arm()
    arm.run(0.05)
    arm.control.take([printed(0.5)[0]])
    arm.run(begin)
    command = arm.command
    for k in range(round(hold / TICK)):
        if k * TICK > 0.1:
            command = command - np.clip(command, -BRAKING * TICK, BRAKING * TICK)
        arm.joints = arm.plant.advance(arm.joints, command, TICK)
    speed = np.abs(arm.joints.qdot)
    step = arm.control.watch(arm.joints.time)  # what the node does first may be either
    assert np.all(np.abs(step.command) <= np.maximum(speed, np.abs(command)) + 1e-9)
    arm.run(arm.joints.time + 1.5)  # on its way home
    assert arm.control.guard.latched is None
    time = arm.joints.time + 0.6
    assert arm.control.take([printed(time)[0]]).index == 0
    position, _, _ = missed(arm.run(time + 1.5, time), printed(time)[0])
    assert position < 0.5  # mm, as without the pause


def test_what_others_hold_back_waits_and_goes_on():
    arm = moving()
    failure = Failure(ArmStop.SECOND_PUBLISHER, count=2, topic="/joint_states", names="/sim, /other")
    arm.control.hold("/joint_states", failure)
    arm.joints = arm.plant.advance(arm.joints, arm.command, 0.0)
    assert rests(arm, lambda joints, now: arm.control.step(joints, now))
    assert arm.control.stopped_by is failure
    arm.control.hold("/joint_states", None)
    arm.run(arm.joints.time + 2.0)
    assert arm.joints.q == pytest.approx(MODEL.waiting, abs=1e-3)


def test_the_first_motion_after_enabling_is_slow_and_strokes_wait_for_it():
    arm = Arm()
    arm.joints = Joints(0.0, MODEL.waiting + 0.3, np.zeros(7))
    fastest = 0.0
    for _ in range(20):
        arm.run(arm.joints.time + 0.1)
        fastest = max(fastest, (np.abs(arm.joints.qdot) / MODEL.speed_limits).max())
    assert arm.control.take(printed(arm.joints.time + 0.6)[:1]).index is None
    assert 0.1 < fastest < 0.16  # first_speed is 0.15
    arm.run(5.0)
    assert arm.control.take(printed(5.6)[:1]).index == 0


def test_a_long_slow_way_home_is_made_without_a_stop():
    arm = Arm()
    arm.control.speed_scale = 0.2
    arm.joints = Joints(0.0, MODEL.waiting + 0.8 * np.array([1, -1, 1, -1, 1, -1, 1]), np.zeros(7))
    slowest = []
    while np.abs(arm.joints.q - MODEL.waiting).max() > 0.1:
        assert arm.joints.time < 40.0  # 0.8 rad at 0.2 * 0.15 rad/s take 27 s
        arm.run(arm.joints.time + 0.1)
        slowest.append(np.abs(arm.joints.qdot[0]))
    arm.run(arm.joints.time + 10.0)
    assert arm.codes == {None}
    assert min(slowest[5:]) > 0.02  # the first joint has the longest way in its least time
    assert arm.joints.q == pytest.approx(MODEL.waiting, abs=1e-3)


def test_a_reduced_speed_acts_at_once():
    arm = moving()
    arm.control.speed_scale = 0.1
    before = arm.command
    while np.any(np.abs(arm.command) > 0.1 * MODEL.speed_limits + 1e-9):
        arm.run(arm.joints.time + TICK)
        assert np.abs(arm.command - before).max() <= BRAKING * TICK + 1e-9
        before = arm.command
    shares = []
    for _ in range(600):
        arm.run(arm.joints.time + 0.01)
        shares.append((np.abs(arm.joints.qdot) / MODEL.speed_limits).max())
    assert max(shares[10:]) < 0.101
    assert arm.joints.q == pytest.approx(MODEL.waiting, abs=1e-3)
    assert arm.control.take(printed(arm.joints.time + 0.5)[:1]).index is None
    with pytest.raises(OutOfRange):
        arm.control.speed_scale = 0.0


def test_speeds_are_differences_of_positions_where_the_driver_sends_none():
    """A swing without measured speeds ends as well, and no difference over a tick makes an overspeed of noise."""
    arm = Arm(plant=PlantParams(q_noise=2e-4))  # rad; over one tick of 2 ms that would be 0.2 rad/s
    racket, there = printed(0.6)[0], None
    while arm.joints.time < 2.5:
        measured = arm.plant.measured(arm.joints, arm.rng)
        blind = Joints(measured.time, measured.q, np.zeros(7))
        step = arm.control.step(blind, has_speeds=False)
        assert arm.control.guard.latched is None
        if arm.joints.time > 0.05 and arm.control.stroke is None and there is None:
            assert arm.control.take([racket]).index == 0
        if arm.joints.time <= racket.time < arm.joints.time + TICK:
            there = arm.plant.racket(arm.joints, step.command, racket.time - arm.joints.time)
        arm.joints = arm.plant.advance(arm.joints, step.command, TICK)
    assert missed(there, racket)[0] < 1.0  # mm; the noise alone makes 0.2 mm


def test_an_arm_that_follows_no_command_rests_and_goes_on_when_it_does():
    """The drives hear nothing for 3 s, as when the network loses what goes one way."""
    arm = Arm()
    arm.run(0.05)
    stuck, commands = arm.joints, []
    for k in range(1, 1500):
        time = 0.05 + k * TICK
        if k % 200 == 1:
            arm.control.take([printed(time + 0.5)[0]])
        step = arm.control.step(Joints(time, stuck.q, np.zeros(7)))
        commands.append(np.abs(step.command).max())
        arm.codes.add(step.reason.code if step.reason else None)
    assert arm.control.guard.latched is None
    arm.joints = Joints(time + TICK, stuck.q, np.zeros(7))
    arm.run(arm.joints.time + 3.0)
    time = arm.joints.time + 0.6
    assert arm.control.take([printed(time)[0]]).index == 0
    assert missed(arm.run(time + 1.5, time), printed(time)[0])[0] < 0.5


def test_an_arm_that_cannot_follow_any_path_rests_and_tries_slowly():
    """Whatever is planned needs 20 rad/s^2, and commands may only change by 1 rad/s^2.

    The strokes come 0.44 s before the strike: with more time the arm waits at first, and the next strokes come before it begins.
    """
    arm = Arm(guard=GuardParams(acceleration=1.0))
    for k in range(40):
        arm.run(0.1 * (k + 1))
        arm.control.take([printed(arm.joints.time + 0.44)[0]])
    assert ArmStop.NOT_FOLLOWING in arm.codes
    assert arm.control.guard.latched is None
    assert np.abs(arm.joints.qdot).max() < 0.5


def test_joints_that_are_named_wrongly_for_a_while_latch_nothing():
    arm = moving(0.42)
    for _ in range(1000):
        wrong = Joints(arm.joints.time, arm.joints.q[::-1], arm.joints.qdot[::-1])
        arm.command = arm.control.step(wrong).command
        arm.joints = arm.plant.advance(arm.joints, arm.command, TICK)
    assert np.all(np.abs(arm.joints.qdot) < 1e-3)
    assert arm.control.guard.latched is None
    arm.run(arm.joints.time + 6.0)  # home, slowly
    time = arm.joints.time + 0.6
    assert arm.control.take([printed(time)[0]]).index == 0


def test_a_strike_far_ahead_is_refused():
    arm = Arm()
    arm.run(0.05)
    refused = arm.control.take(printed(8.0)).refused
    assert refused.code is ArmStop.FAR_AHEAD
    assert refused.values["ahead"] == pytest.approx(7.95, abs=0.01)


def test_the_servo_pulls_towards_the_path():
    rest, limits = plan(MODEL, HELD, None, 0.0), MODEL.speed_limits
    assert np.all(follow(rest, 1.0, MODEL.waiting, limits, ServoParams()) == 0.0)
    assert follow(rest, 1.0, MODEL.waiting - 0.01, limits, ServoParams(gain=15.0)) == pytest.approx(np.full(7, 0.15))
    assert follow(rest, 1.0, MODEL.waiting + 9.0, limits, ServoParams()) == pytest.approx(-limits)


def test_nothing_is_left_to_compile_once_warm():
    """Neither while it plays nor in faults, whose kernels hold up the stop itself.

    In a process of its own, for here the other tests have compiled; a kernel that is loaded while a ball flies costs 0.1 s.
    """
    script = """
import importlib, pkgutil, tt_arm
from numba.core.dispatcher import Dispatcher
from arm.dissertation_strokes import printed
from arm.test_control import MODEL, Arm
from arm.test_control_fuzz import FaultyArm
from hypothesis import settings
from hypothesis.stateful import run_state_machine_as_test
from tt_arm.control import warm

def kernels():
    names = [m.name for m in pkgutil.walk_packages(tt_arm.__path__, "tt_arm.") if not m.name.endswith("_node")]
    modules = [importlib.import_module(name) for name in names]
    return {(v.__module__, k, str(s)) for m in modules for k, v in vars(m).items() if isinstance(v, Dispatcher) for s in v.signatures}

warm(MODEL)
before, arm = kernels(), Arm()
arm.run(0.05)
arm.control.take(printed(0.5)[:1])
arm.run(0.7)
arm.control.take([*printed(1.3), *printed(0.75)])
arm.run(2.0)
run_state_machine_as_test(FaultyArm, settings=settings(max_examples=10, stateful_step_count=20, derandomize=True, deadline=None))
print(sorted(kernels() - before))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=Path(__file__).parents[1])
    assert done.stdout.strip() == "[]"


def test_a_swing_is_committed_shortly_before_its_strike_and_after_it():
    first = printed(0.55)[0]
    newer = RacketState(0.553, first.position + [0.01, -0.01, 0.005], first.velocity, first.alpha, first.beta)
    for now in (0.52, 0.6):  # 30 ms before the strike, and 50 ms after it
        arm = Arm(params=ControlParams(commit=0.06))
        arm.run(0.05)
        arm.control.take([first])
        arm.run(now)
        refused = arm.control.take([newer]).refused
        assert refused.code is ArmStop.SWING_COMMITTED
        assert refused.values["left"] == pytest.approx(0.55 - now, abs=0.01)


def test_a_correction_that_is_too_large_keeps_the_swing():
    first = printed(0.55)[0]
    far = RacketState(0.55, first.position + [0.0, 0.1, 0.0], first.velocity, first.alpha, first.beta)
    arm = Arm(params=ControlParams(largest_correction=0.05))
    arm.run(0.05)
    arm.control.take([first])
    arm.run(0.2)
    refused = arm.control.take([far]).refused
    assert refused.code is ArmStop.CORRECTION_TOO_LARGE
    assert refused.values["distance"] == pytest.approx(0.1)
    assert missed(arm.run(0.6, first.time), first)[0] < 0.5


def test_the_search_for_a_sooner_stroke_is_interrupted_and_begins_again_with_newer_strokes():
    arm, asked = Arm(), list[bool]()
    arm.run(0.05)
    assert arm.control.take([printed(0.6)[0]]).index == 0
    arm.run(0.65)
    second = printed(1.3)  # 0.7 s after the first ball: the arm hurries

    def take(rackets, goes_on):
        asked.clear()
        return arm.control.take(rackets, lambda: asked.append(goes_on) or goes_on)

    first = take(second, False)
    assert first.swing is not None and not first.corrects
    assert asked == [False]
    kept = take(second, True)  # the same strokes: the swing stays unless a sooner one is found, and that search is made to its end
    assert len(asked) == len(second)
    assert kept.swing is None or kept.swing.end_time < first.swing.end_time
    take(second, True)
    assert asked == []


def test_where_the_way_to_the_best_posture_is_refused_the_nearest_one_is_taken():
    """Of these strokes 957 were made on the day with the best posture alone, and 970 with the nearest one where its way is refused."""
    rng, made = np.random.default_rng(1), 0
    for _ in range(1000):
        position = rng.uniform([-0.35, 0.40, 0.12], [0.0, 1.125, 0.45])
        velocity = rng.uniform([0.5, -0.3, 0.2], [1.6, 0.3, 1.7])
        racket = RacketState(0.6, position, velocity, rng.normal(0.0, 0.12), rng.uniform(0.7, 1.8))
        made += select_stroke(MODEL, [racket], HELD, SwingLimits(), ReachParams(), SelectionParams()).swing is not None
    assert made >= 964
