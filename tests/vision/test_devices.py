"""Devices: stamps at the grab, settings, drops, a lost cable, images that change."""

import cv2
import numpy as np
import pytest
from tt_vision.capture.devices import DeviceCounts, DeviceError, DeviceParams, DeviceReason, grabs
from tt_vision.capture.sources import NotAnImage, to_grey


class Clock:
    """Advances only when told."""

    def __init__(self):
        self.time = 0.0

    def __call__(self):
        return self.time


class Device:
    """What cv2.VideoCapture promises; `script` holds one word for each grab."""

    def __init__(self, clock, script, side):
        self.clock, self.script, self.side, self.set_to = clock, script, side, {}

    def isOpened(self):
        return True

    def set(self, key, value):
        self.set_to[key] = value
        return key != cv2.CAP_PROP_TRIGGER

    def grab(self):
        self.word = self.script.pop(0)
        self.clock.time += {"late": 3.0, "lost": 0.0}.get(self.word, 1.0) / 900.0 * (self.side == 0)
        return self.word != "lost"

    def retrieve(self):
        self.clock.time += 1e-4  # decoding takes its time and must not count
        return True, np.full((24, 48 if self.word == "wide" else 32, 3), 100, np.uint8)

    def release(self):
        self.script = ["lost"]


def play(words, params=None, count=None):
    clock, counts, opened = Clock(), DeviceCounts(), []
    scripts = [list(words), list(words)]

    def opener(number):
        opened.append(Device(clock, scripts[number], number))
        return opened[-1]

    source = grabs([0, 1], clock, params or DeviceParams(retry=0.0), 900.0, counts, opener)
    return [next(source) for _ in range(count or len(words))], counts, opened


def test_stamps_are_of_the_grab_and_of_the_middle_of_the_exposure():
    taken, counts, opened = play(["ok"] * 3, DeviceParams(exposure=200e-6))
    assert taken[0][0] == pytest.approx(1.0 / 900.0 - 100e-6)
    assert opened[0].set_to[cv2.CAP_PROP_EXPOSURE] == pytest.approx(2.0)  # units of 100 us
    assert (counts.dropped, counts.lost) == (0, 0)


def test_drops_and_lost_devices_are_counted_and_survived():
    taken, counts, opened = play(["ok", "late", "lost", "ok"], count=3)
    assert len(taken) == 3 and (counts.dropped, counts.lost) == (2, 1) and len(opened) == 4


def test_a_region_is_cut_out_and_colour_becomes_grey():
    ((_, images),), _, _ = play(["ok"], DeviceParams(region=(4, 2, 16, 12)))
    assert images[0].shape == (12, 16, 3) and to_grey(images[0]).shape == (12, 16)


@pytest.mark.parametrize(
    "words, params, code",
    [
        (["ok", "wide"], {}, DeviceReason.OTHER_SIZE),
        (["ok"], {"trigger": True}, DeviceReason.NO_SETTING),
        (["ok"], {"region": (20, 0, 16, 12)}, DeviceReason.REGION_OUTSIDE),
        (["ok"], {"region": (0, 0, 2, 2)}, DeviceReason.BAD_REGION),
    ],
)
def test_what_is_wrong_has_a_name(words, params, code):
    with pytest.raises(DeviceError) as error:
        play(words, DeviceParams(**params))
    assert error.value.failure.code is code


def test_another_kind_of_pixels_is_refused():
    with pytest.raises(NotAnImage):
        to_grey(np.zeros((8, 8), np.float32))
