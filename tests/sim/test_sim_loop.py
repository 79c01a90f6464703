"""The simulator's loop without ROS: launches on time, images at their stamps, joints every tick; and the schedules in it."""

import time
from collections import deque

import numpy as np
import pytest
from tt_arm.model import ArmModel
from tt_core.physics import Physics
from tt_core.states import BallState
from tt_sim.frame_schedule import FrameSchedule
from tt_sim.launch_store import ReadyImage, ReadyLaunch
from tt_sim.pace import SLEW, Pace
from tt_sim.sim_loop import SimLoop
from tt_sim.sim_params import SimParams
from tt_sim.simulated_robot import warm
from tt_sim.world.drive import Drive, DriveParams
from tt_sim.world.plant import Plant
from tt_sim.world_file import WorldParams
from tt_vision.rig import FRAME_RATE

MODEL = ArmModel.pa10()
BALL = BallState(0.0, [2.6, 0.76, 0.3], [-5.0, 0.0, 1.5], [0.0, -200.0, 0.0])


def launch(number, dues=(0.01, 0.02)):
    images = deque(ReadyImage(due, due - 0.001, side, f"{number} {due} {side}") for due in dues for side in (0, 1))
    return ReadyLaunch(number, "top 3", BALL, Physics.liu(), images)


class Store:
    """Launches that are ready from the start."""

    def __init__(self, *launches):
        self.ready, self.last_image = deque(launches), -np.inf


class Heard:
    """Keeps what the loop makes."""

    def __init__(self):
        self.images, self.clock, self.balls, self.joints, self.ends, self.brakes, self.records = [], [], [], [], [], [], []
        self.ticks = []  # s, simulated time at the end of each tick

    def publish_image(self, side, stamp, message):
        self.images.append((side, stamp, message))

    def publish_clock(self, now):
        self.clock.append(now)

    def publish_ball(self, ball):
        self.balls.append(ball)

    def publish_joints(self, joints, effort):
        assert np.abs(effort).max() < MODEL.torque_limits.max()  # N m; it holds its own weight
        self.joints.append(joints)

    def publish_truth(self, tick):
        self.ticks.append(tick.joints.time)

    def wants_pixels(self):
        return False

    def publish_pixel(self, side, stamp, pixel):
        raise AssertionError("nobody listens")

    def report_drive(self, is_braking):
        self.brakes.append(is_braking)

    def report_record(self, record):
        self.records.append(record.kept)

    def report_end(self, launch, outcome):
        self.ends.append((launch.number, outcome))


def run(store, until, *, rate=0.0, dark=(), **params):
    """The loop until `until(heard)` is true, at most 60 real seconds.

    The drives accept a command for 10 s, so that no tick counts as late: a late one has no joint state.
    """
    heard, plant = Heard(), Plant(MODEL)
    warm(plant)  # the loop counts real seconds
    drive = Drive(MODEL.limits, DriveParams(command_timeout=10.0))
    loop = SimLoop(SimParams(**params), WorldParams(), plant, drive, store, dark, heard)
    loop.rate, end = rate, time.monotonic() + 60.0
    loop.run(lambda: not until(heard) and time.monotonic() < end)
    assert time.monotonic() < end, "not within 60 s"
    return heard


def test_a_ready_ball_is_launched_shown_and_its_end_is_told():
    heard = run(Store(launch(1)), lambda heard: heard.ends, rtf=3.0)
    (ball,) = heard.balls
    assert ball.vector == pytest.approx(BALL.vector)
    dues = [(0.01, 0), (0.01, 1), (0.02, 0), (0.02, 1)]
    assert [message for _, _, message in heard.images] == [f"1 {due} {side}" for due, side in dues]
    assert [stamp - ball.time for _, stamp, _ in heard.images] == pytest.approx([due - 0.001 for due, _ in dues], abs=1e-6)
    ((number, outcome),) = heard.ends
    assert number == 1 and outcome.launched is ball
    assert heard.records[0]


def test_one_ball_at_a_time_on_request_and_several_at_a_rate():
    one = run(Store(launch(1), launch(2)), lambda heard: len(heard.ticks) > 50)
    assert len(one.balls) == 1
    several = run(Store(launch(1), launch(2)), lambda heard: len(heard.balls) == 2, rate=94.0, rtf=3.0)
    assert np.diff([ball.time for ball in several.balls]) == pytest.approx([60.0 / 94.0], abs=0.004)  # s; whole ticks of 2 ms


def test_joints_come_every_tick_and_the_clock_at_its_rate():
    def is_real_time(heard):
        return len(heard.joints) > 150 and abs(heard.joints[-1].time - time.time()) < 0.5  # s

    heard = run(Store(), is_real_time)
    assert np.diff([joints.time for joints in heard.joints]) == pytest.approx(0.002, abs=1e-6)  # s; a stamp of today is known to 2.4e-7
    assert np.median(np.diff(heard.clock)) == pytest.approx(0.004, abs=1e-6)


def test_a_paused_loop_stands_still_and_steps():
    heard, plant = Heard(), Plant(MODEL)
    loop = SimLoop(SimParams(), WorldParams(), plant, Drive(MODEL.limits), Store(), (), heard)
    moments = []  # s, simulated, at each look

    def is_running():
        n = len(moments)
        moments.append(heard.ticks[-1] if heard.ticks else 0.0)
        if n == 20:
            loop.pause(True)
        elif n == 40:
            loop.step(0.02)
        elif n == 80:
            loop.pause(False)
        return n < 120

    loop.run(is_running)
    assert moments[40] == moments[21] > 0.0  # it stood still
    assert moments[79] - moments[40] == pytest.approx(0.02, abs=1e-6)  # one step
    assert np.diff(heard.ticks) == pytest.approx(0.002, abs=1e-6)  # s; it goes on where it stood
    assert heard.ticks[-1] > moments[79] + 0.05


def test_dark_frames_leave_only_if_asked_for():
    heard = run(Store(), lambda heard: len(heard.images) > 100, dark=("left", "right"), always_on=True)
    assert [message for _, _, message in heard.images[:4]] == ["left", "right"] * 2
    assert np.diff([stamp for side, stamp, _ in heard.images if side == 0]) == pytest.approx(1 / FRAME_RATE, abs=1e-6)
    assert run(Store(), lambda heard: len(heard.ticks) > 50, dark=("left", "right")).images == []


def test_frames_of_a_ball_come_in_place_of_dark_ones():
    frames = FrameSchedule(("l", "r"), 10.0)
    assert frames.due == 10.0 and not frames.shows_ball
    frames.show(launch(1, (0.01,)), 10.0)
    assert frames.shows_ball and frames.due == pytest.approx(10.01)
    assert frames.pop() == [(0, pytest.approx(10.009), "1 0.01 0")]
    assert frames.pop() == [(1, pytest.approx(10.009), "1 0.01 1")]
    assert not frames.shows_ball and frames.due == pytest.approx(10.01 + 1 / FRAME_RATE)
    assert frames.pop() == [(0, pytest.approx(10.01 + 1 / FRAME_RATE), "l"), (1, pytest.approx(10.01 + 1 / FRAME_RATE), "r")]


def test_a_pace_runs_as_fast_as_asked():
    pace = Pace(2.0)
    now = time.monotonic()
    assert pace.late(pace.start, now) >= 0.0  # s, since it was made
    assert pace.late(pace.start + 1.0, now) == pytest.approx(pace.late(pace.start, now) - 0.5)
    pace.sleep_until(pace.start + 0.1)
    assert pace.late(pace.start + 0.1, time.monotonic()) >= 0.0


def test_stamps_follow_the_system_s_clock_slowly(monkeypatch):
    pace = Pace(1.0)
    now = time.monotonic()
    before = pace.late(pace.start, now)
    real = time.time
    monkeypatch.setattr(time, "time", lambda: real() + 1.0)  # the time service has set the clock
    pace.follow_system_clock()
    assert pace.late(pace.start, now) - before == pytest.approx(SLEW, rel=1e-3)
