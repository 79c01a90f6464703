"""Whatever images come, in whatever order and with whatever stamps, the assembler stays small and makes a burst of the next ball."""

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule
from tt_core.errors import TtError
from tt_vision.capture.assembler import MOST_WAITING_BYTES, MOST_WAITING_IMAGES, Assembler
from tt_vision.capture.burst import Burst

FILM = []  # (side, time, image) of six frames, set by the fixture
KINDS = [np.zeros((1, 1), np.uint8), np.full((64, 64), 8, np.uint8), np.full((232, 232), 255, np.uint8), np.full((232, 300), 8, np.uint16)]
stamps = st.floats(-1e3, 1e3) | st.sampled_from([0.0, 1e9, -1e9])


class FaultyCameras(RuleBasedStateMachine):
    """Two cameras and what a network and a driver make of their images; `now` is the true time."""

    @initialize(refined=st.booleans())
    def begin(self, refined):
        from tt_vision.capture.assembler import BurstParams

        self.assembler, self.now = Assembler(BurstParams(refined=8 if refined else 0)), 100.0

    def add(self, side, time, image):
        try:
            burst = self.assembler.add(side, time, image)
        except TtError:
            return None
        assert burst is None or (isinstance(burst, Burst) and np.all(np.diff(burst.times) > 0.0))
        return burst

    @rule(side=st.integers(0, 1), time=stamps, kind=st.integers(0, len(KINDS) - 1), count=st.integers(1, 80))
    def an_image_repeats(self, side, time, kind, count):
        for _ in range(count):
            self.add(side, self.now + time, KINDS[kind])

    @rule(side=st.integers(0, 1), count=st.integers(1, 200))
    def one_camera_alone(self, side, count):
        for k in range(count):
            self.add(side, self.now + k / 900.0, FILM[side][2])
        self.now += count / 900.0

    @rule(which=st.lists(st.integers(0, 11), max_size=12), error=stamps)
    def a_ball_with_wrong_stamps(self, which, error):
        for i in which:
            side, time, image = FILM[i]
            self.add(side, self.now + time + error, image)

    @rule(part=st.integers(1, 11), times=st.integers(1, 3))
    def a_part_of_a_ball(self, part, times):
        for side, time, image in FILM[:part] * times:
            self.add(side, self.now + time, image)
        self.now += 0.01

    @rule(time=st.floats(-100.0, 100.0))
    def the_clock_jumps(self, time):
        self.now += time

    @rule()
    def the_next_ball_is_seen(self):
        """One second and one ball later at the latest, the time in which stamps may go back."""
        bursts = []
        for _ in range(2):
            self.now += 1.1
            bursts = [burst for side, time, image in FILM if (burst := self.add(side, self.now + time, image))]
        assert len(bursts) == 1 and len(bursts[0].times) == 6

    @invariant()
    def it_stays_small(self):
        for queue in self.assembler._waiting if hasattr(self, "assembler") else ():
            assert len(queue) <= MOST_WAITING_IMAGES + 1
            assert sum(one.seen.image.nbytes for one in queue if one.seen) <= MOST_WAITING_BYTES + 232 * 300 * 2
        assert not hasattr(self, "assembler") or len(self.assembler._pairs) <= 12


@pytest.fixture(scope="module", autouse=True)
def frames(film):
    shot = film(3, count=6, velocity=[-5.0, 0.0, 0.5])
    FILM[:] = [(side, t - shot.times[0], shot.frames[side, k]) for k, t in enumerate(shot.times) for side in (0, 1)]


TestFaultyCameras = FaultyCameras.TestCase
TestFaultyCameras.settings = settings(max_examples=settings.default.max_examples // 5, stateful_step_count=10)
