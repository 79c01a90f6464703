"""Whatever happens to joint states, strokes, clocks and people, the arm keeps its limits, touches nothing, and goes on by itself."""

from collections import deque

import numpy as np
from arm.dissertation_strokes import printed
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from tt_arm.control import ArmControl
from tt_arm.joints import Joints
from tt_arm.model import ArmModel
from tt_arm.safety.clearance import clearance
from tt_arm.safety.stops import ArmStop
from tt_core.failures import Failure
from tt_core.states import RacketState
from tt_sim.world.drive import Drive
from tt_sim.world.plant import Plant

MODEL, TICK = ArmModel.pa10(), 0.002
HELD = Failure(ArmStop.SECOND_PUBLISHER, count=2, topic="/joint_states", names="/a, /b")
number = st.floats(allow_nan=False, allow_infinity=False, width=32) | st.sampled_from([0.0, 1e17, -1e17, 1e300])
seven = st.lists(number, min_size=7, max_size=7).map(np.array)


class FaultyArm(RuleBasedStateMachine):
    """The arm with its drive and plant, in their own time; `offset` is what the stamps' clock is ahead of that."""

    @initialize()
    def begin(self):
        self.control, self.plant = ArmControl(MODEL), Plant(MODEL)
        self.drive = Drive(MODEL.limits)
        self.time, self.offset, self.command = 0.0, 100.0, np.zeros(7)
        self.joints = Joints(0.0, MODEL.waiting, np.zeros(7))
        self.control.enable(True)

    def passes(self, duration):
        """Time in which the drive obeys what it has."""
        for _ in range(round(duration / TICK)):
            followed = self.drive.command(self.time, TICK, self.joints.qdot, self.drive.params.command_timeout)
            self.joints = self.plant.advance(self.joints, followed, TICK)
            self.time += TICK
            assert np.all(self.joints.q > MODEL.position_limits[:, 0]) and np.all(self.joints.q < MODEL.position_limits[:, 1])
            assert clearance(self.joints.q, MODEL.bodies)[0] > 0.0

    def send(self, step):
        assert np.isfinite(step.command).all()
        assert np.all(np.abs(step.command) <= MODEL.speed_limits + 1e-9)
        self.drive.take(step.command, self.time)
        return step

    def tick(self):
        state = Joints(self.time + self.offset, self.joints.q, self.joints.qdot)
        step = self.send(self.control.step(state, self.time, state.time))
        self.passes(TICK)
        return step

    @rule(ticks=st.integers(1, 200))
    def goes_well(self, ticks):
        for _ in range(ticks):
            self.tick()

    @rule(which=st.integers(0, 4), lead=st.floats(0.2, 0.9), count=st.integers(0, 3))
    def a_ball_comes(self, which, lead, count):
        self.control.take([printed(self.time + self.offset + lead)[which]] * count)

    @rule(position=st.lists(number, min_size=3, max_size=3), velocity=st.lists(number, min_size=3, max_size=3), lead=number)
    def strokes_are_absurd(self, position, velocity, lead):
        """As far as the conversion of messages lets them pass."""
        position, velocity, lead = np.clip(position, -100.0, 100.0), np.clip(velocity, -100.0, 100.0), float(np.clip(lead, -1.0, 100.0))
        self.control.take([RacketState(self.time + self.offset + lead, position, velocity, 0.1, 1.0)])

    @rule(q=seven, qdot=seven, ahead=number)
    def a_state_is_absurd(self, q, qdot, ahead):
        self.send(self.control.step(Joints(self.time + self.offset + ahead, q, qdot), self.time, self.time + self.offset))
        self.passes(TICK)

    @rule(ticks=st.integers(1, 100), error=st.sampled_from([-10.0, -0.1, -0.01, 0.01, 10.0]))
    def stamps_are_off(self, ticks, error):
        for _ in range(ticks):
            state = Joints(self.time + self.offset + error, self.joints.q, self.joints.qdot)
            self.send(self.control.step(state, self.time, self.time + self.offset))
            self.passes(TICK)

    @rule(ticks=st.integers(1, 100))
    def stamps_stand_still(self, ticks):
        stamp = self.time + self.offset
        for _ in range(ticks):
            self.send(self.control.step(Joints(stamp, self.joints.q, self.joints.qdot), self.time, self.time + self.offset))
            self.passes(TICK)

    @rule(ticks=st.integers(1, 200), delay=st.floats(0.0, 0.1))
    def states_come_late(self, ticks, delay):
        past = deque([(self.time, self.joints)])
        for _ in range(ticks):
            while len(past) > 1 and past[1][0] <= self.time - delay:
                past.popleft()
            then, old = past[0]
            state = Joints(then + self.offset, old.q, old.qdot)
            self.send(self.control.step(state, self.time, self.time + self.offset))
            self.passes(TICK)
            past.append((self.time, self.joints))

    @rule(change=st.floats(-1e3, 1e3))
    def the_clock_jumps(self, change):
        self.offset += change

    @rule(looks=st.integers(1, 200))
    def states_cease(self, looks):
        for _ in range(looks):
            step = self.control.watch(self.time)
            if step is not None:
                self.send(step)
            self.passes(TICK)

    @rule(duration=st.floats(0.01, 0.5))
    def the_process_stalls(self, duration):
        self.passes(duration)

    @rule(scale=st.floats(0.01, 1.0))
    def a_person_changes_the_speed(self, scale):
        self.control.speed_scale = scale
        self.goes_well(100)
        self.control.speed_scale = 1.0

    @rule()
    def a_second_publisher_comes_and_goes(self):
        self.control.hold("/joint_states", HELD)
        self.goes_well(30)
        assert np.all(np.abs(self.control.guard.last) <= MODEL.speed_limits)
        self.control.hold("/joint_states", None)

    @rule()
    def a_person_stops_and_enables(self):
        self.control.enable(False)
        self.goes_well(200)
        assert np.abs(self.joints.qdot).max() < 1e-3
        self.control.enable(True)

    @precondition(lambda self: self.control.enabled)
    @rule()
    def play_goes_on(self):
        """After whatever was before, the arm comes home and takes the next ball."""
        self.goes_well(600)  # what is on its way comes first
        for _ in range(5000):  # s / TICK; the slow motion after enabling takes most of it
            self.tick()
            if np.abs(self.joints.q - MODEL.waiting).max() < 1e-3:
                break
        assert self.control.guard.latched is None
        assert np.abs(self.joints.q - MODEL.waiting).max() < 2e-3
        self.goes_well(10)
        assert self.control.take([printed(self.time + self.offset + 0.6)[0]]).index == 0

    @invariant()
    def nothing_latched(self):
        assert not hasattr(self, "control") or self.control.guard.latched is None


TestFaultyArm = FaultyArm.TestCase
TestFaultyArm.settings = settings(max_examples=settings.default.max_examples // 7, stateful_step_count=12)  # about 10 s
