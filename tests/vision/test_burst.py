"""One burst for each ball, whatever the network does to the images."""

import itertools
import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tt_core.errors import BadChoice, BadShape, NotFinite, OutOfRange, TtError
from tt_vision.capture.assembler import MOST_WAITING_BYTES, MOST_WAITING_IMAGES, Assembler, BurstParams
from tt_vision.capture.burst import Burst, TimesNotRising
from tt_vision.rig import high_speed_pair

DARK = np.full((232, 232), 8, np.uint8)


@pytest.fixture(scope="module")
def stream(film):
    """(side, time, image) of nine whole frames, as two cameras send them."""
    shot = film(3, count=9, velocity=[-5.0, 0.0, 0.5])
    return [(side, t, shot.frames[side, k]) for k, t in enumerate(shot.times) for side in (0, 1)]


def feed(assembler, images):
    return [burst for side, time, image in images if (burst := assembler.add(side, time, image))]


def moved(stream, by):
    return [(side, time + by, image) for side, time, image in stream]


def test_a_burst_is_ready_with_its_last_image_and_comes_once(stream):
    assembler = Assembler(BurstParams(frames=6))
    assert feed(assembler, stream[:11]) == []
    (burst,) = feed(assembler, stream[11:])
    assert [stack.shape for stack in burst.images] == [(6, 232, 232)] * 2
    assert burst.times == pytest.approx([t for side, t, _ in stream[:12] if side == 0])
    assert assembler.counts.spare == 3


def test_a_gap_starts_a_new_ball(stream):
    bursts = feed(Assembler(), stream + moved(stream, 0.2))
    assert [b.times[0] for b in bursts] == pytest.approx([stream[0][1], stream[0][1] + 0.2])


@given(seed=st.integers(0, 1000), lost=st.sets(st.integers(0, 17), max_size=3))
def test_lost_doubled_and_shuffled_images_are_survived(stream, seed, lost):
    rng = random.Random(seed)
    images = [image for i, image in enumerate(stream) if i not in lost]
    images += rng.sample(images, 3)
    images = [image for _, image in sorted(zip(itertools.count(), images, strict=False), key=lambda e: e[0] + rng.uniform(0.0, 6.0))]
    bursts = feed(Assembler(), images)
    assert len(bursts) == 1
    assert (np.diff(bursts[0].times) > 0.0).all()
    of = {(side, time): image for side, time, image in stream}
    for t, left, right in zip(bursts[0].times, *bursts[0].images, strict=True):
        assert (left == of[0, t]).all() and (right == of[1, t]).all()


def test_duplicates_and_unpaired_images_are_counted(stream):
    assembler = Assembler()
    feed(assembler, [stream[0], stream[0], *stream[3:]])
    feed(assembler, moved(stream[:1], 0.5))
    assert (assembler.counts.duplicate, assembler.counts.unpaired) == (1, 2)


def test_a_ball_that_leaves_early_still_has_its_burst(stream):
    partial = np.zeros_like(DARK)
    partial[100:160, :30] = 200
    left = [(side, stream[8][1] + 0.0, partial) for side in (0, 1)]
    (burst,) = feed(Assembler(), [*stream[:8], *left])
    assert len(burst.times) == 4


def test_dark_frames_between_balls_make_nothing(stream):
    assembler = Assembler()
    dark = [(side, stream[-1][1] + 0.001 * k, DARK) for k in range(1, 200) for side in (0, 1)]
    assert len(feed(assembler, stream + dark + moved(stream, 0.3))) == 2
    assert (assembler.counts.not_whole, assembler.counts.unpaired) == (0, 0)


def test_a_recording_that_starts_again_is_a_new_ball(stream):
    assert len(feed(Assembler(), moved(stream, 100.0) + stream)) == 2


def test_an_image_from_long_ago_is_late(stream):
    assembler = Assembler()
    feed(assembler, moved(stream, 0.3) + stream[:2])
    assert assembler.counts.late == 2


def test_bad_values_name_themselves():
    with pytest.raises(OutOfRange) as error:
        BurstParams(frames=2)
    assert (error.value.name, error.value.value, error.value.low) == ("frames", 2, 3)
    with pytest.raises(TtError):
        Assembler().add(0, 0.0, np.zeros((232, 232)))


def test_more_frames_make_a_refined_burst(stream):
    first, second = feed(Assembler(BurstParams(frames=4, refined=8)), stream)
    assert (len(first.times), len(second.times)) == (4, 8)
    assert (first.refined, second.refined) == (False, True)
    assert (second.times[:4] == first.times).all()
    assert len(feed(Assembler(BurstParams(frames=4, refined=8)), stream + moved(stream, 0.2))) == 4
    assert len(feed(Assembler(BurstParams(frames=4, refined=10)), stream)) == 1  # nine came, and the ball did not leave


def test_one_camera_alone_and_a_clock_that_is_behind(stream):
    (burst,) = feed(Assembler(BurstParams(alone="right")), stream)
    assert len(burst.images) == 1
    assert (burst.images[0] == np.array([image for side, _, image in stream if side == 1][:6])).all()
    behind = [(side, time - 0.5 * side, image) for side, time, image in stream]
    (burst,) = feed(Assembler(BurstParams(clock_offset=0.5)), behind)
    assert burst.times == pytest.approx([t for side, t, _ in stream[:12] if side == 0])
    with pytest.raises(BadChoice) as error:
        BurstParams(alone="both")
    assert (error.value.name, error.value.value) == ("alone", "both")
    with pytest.raises(OutOfRange) as error:
        BurstParams(frames=6, refined=5)
    assert (error.value.name, error.value.low) == ("refined", 7)


def test_an_image_of_another_size_within_a_ball_is_refused_and_the_next_ball_is_measured(stream):
    assembler = Assembler()
    feed(assembler, stream[:6])
    larger = np.pad(stream[6][2], ((0, 8), (0, 0)))
    with pytest.raises(BadShape) as error:
        assembler.add(0, stream[6][1], larger)
    assert (error.value.shape[0], error.value.wanted[0]) == (240, 232)
    with pytest.raises(BadShape):
        assembler.add(0, stream[6][1], stream[6][2].astype(np.uint16))
    assert len(feed(assembler, moved(stream, 0.2))) == 1
    grown = [(side, time + 0.4, np.pad(image, ((0, 8), (0, 0)))) for side, time, image in stream]
    assert len(feed(assembler, grown)) == 1  # a camera that has been set anew


STAMPS = {
    "distinct, one side": lambda k: (0, 1e-3 * k),
    "far apart, one side": lambda k: (0, 0.9 * k),
    "equal": lambda k: (k % 2, 0.0),
    "equal, one side": lambda k: (1, 5.0),
    "running back": lambda k: (k % 2, -1e-3 * k),
    "running back, one side": lambda k: (0, -1e-5 * k),
    "far apart": lambda k: (k % 2, 1e6 * k),
    "to and fro": lambda k: (k % 2, 0.04 * (k % 3) + 1e-6 * k),
    "never in pairs": lambda k: (k % 2, 1e-3 * k + 4e-4 * (k % 2)),
}


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("name", STAMPS)
def test_no_stamps_make_it_hold_more_than_it_may(stream, name, dark):
    """Whatever the stamps are, what is held has a bound, and the next ball is measured."""
    assembler, ball = Assembler(), stream[6][2]
    for k in range(1000):
        side, time = STAMPS[name](k)
        assembler.add(side, 100.0 + time, DARK if dark else ball)
        assert all(len(queue) <= MOST_WAITING_IMAGES for queue in assembler._waiting)
        assert len(assembler._pairs) <= assembler.params.frames
    assert len(feed(assembler, moved(stream, 1e9))) == 1


def test_large_images_wait_in_smaller_numbers():
    assembler, image = Assembler(), np.zeros((4096, 2048), np.uint8)
    image[1000:1400, 1000:1400] = 200
    for k in range(40):
        assembler.add(0, 1e-4 * k + 1e-3 * k, image)
    assert len(assembler._waiting[0]) <= MOST_WAITING_BYTES // image.nbytes


def test_a_burst_holds_what_fits_together_only(stream):
    images = np.array([image for side, _, image in stream if side == 0])
    times, camera = np.arange(9) / 900.0, high_speed_pair()[0]
    assert len(Burst((images,), times, (camera,))) == 9
    with pytest.raises(BadShape) as error:
        Burst((images,), times[:8])
    assert error.value.shape == (1, 9)
    with pytest.raises(BadShape):
        Burst((images, images), times, (camera,))
    with pytest.raises(BadShape) as error:
        Burst((images[:, :100],), times, (camera,))
    assert error.value.shape == (9, 100, 232)
    with pytest.raises(TimesNotRising):
        Burst((images,), times[::-1])
    with pytest.raises(NotFinite):
        Burst((images,), times * np.nan)


def test_some_frames_of_a_burst_keep_their_detections(stream):
    (burst,) = feed(Assembler(), stream)
    some = burst.only([1, 4])
    assert (some.images[1] == burst.images[1][[1, 4]]).all()
    assert (some.times == burst.times[[1, 4]]).all()
    assert some.detections == tuple((row[1], row[4]) for row in burst.detections)
