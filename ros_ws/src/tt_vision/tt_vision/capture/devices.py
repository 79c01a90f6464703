"""Two cameras that the operating system knows, through OpenCV: stamped at the grab, set up by parameters, opened again when lost."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from tt_core.errors import TtError
from tt_core.params import check, param


class DeviceError(TtError):
    """A device that cannot be opened, does not take a setting, or changes its images."""


@dataclass(frozen=True)
class DeviceParams:
    """Of both cameras. OpenCV counts exposures of some drivers in powers of two seconds: exposure_log2."""

    exposure: float = param(0.0, "s", "; 0 leaves it as the driver has it", low=0.0, high=1.0)
    exposure_log2: bool = param(False, "", "the driver wants log2 of the exposure (DirectShow), not units of 100 us (V4L2)")
    trigger: bool = param(False, "", "frames wait for the trigger input")
    region: tuple[int, int, int, int] = param(
        (0, 0, 0, 0), "pixels", ": left, top, width, height of what is published; all 0: the whole image"
    )
    retry: float = param(1.0, "s", "between attempts to open a lost device again", low=0.0, high=60.0)
    patience: float = param(60.0, "s", "without images after which it is given up", low=0.0)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)
        if len(self.region) != 4 or min(self.region) < 0 or (any(self.region) and min(self.region[2:]) < 8):
            raise DeviceError(f"region = {list(self.region)} is not left, top, width, height with at least 8 x 8 pixels, or all 0")


@dataclass
class DeviceCounts:
    """Since the start. dropped: frames that the stamps say are missing. lost: how often a device was opened again."""

    dropped: int = 0
    lost: int = 0


Open = Callable[[int], Any]


def grabs(
    numbers: Sequence[int],
    now: Callable[[], float],
    params: DeviceParams,
    frame_rate: float,
    counts: DeviceCounts,
    opener: Open = cv2.VideoCapture,
) -> Iterator[tuple[float, list[np.ndarray]]]:
    """(time s, images as they come) of all devices together, stamped when grabbed, before anything is decoded, less half the exposure.

    Raises DeviceError for a device that cannot be opened at the start or for `patience`, and for images whose size changes.
    """
    captures = _open(numbers, params, opener)
    shapes: list[tuple[int, ...]] = []
    last = None
    try:
        while True:
            stamps, grabbed = [], []
            for capture in captures:
                grabbed.append(capture.grab())
                stamps.append(now())
            at = sum(stamps) / len(stamps)
            taken = [capture.retrieve() for capture in captures] if all(grabbed) else []
            if not taken or not all(good for good, _ in taken):
                _release(captures)
                captures = _again(numbers, params, opener)
                counts.lost += 1
                last = None
                continue
            images = [_cut(image, params.region) for _, image in taken]
            shapes = shapes or [image.shape[:2] for image in images]
            for number, image, shape in zip(numbers, images, shapes, strict=True):
                if image.shape[:2] != shape:
                    raise DeviceError(f"device {number} sends {image.shape[1]} x {image.shape[0]} pixels, before {shape[1]} x {shape[0]}")
            if last is not None:
                counts.dropped += max(0, round((at - last) * frame_rate) - 1)
            last = at
            yield at - 0.5 * params.exposure, images
    finally:
        _release(captures)


def _open(numbers: Sequence[int], params: DeviceParams, opener: Open) -> list[Any]:
    captures = []
    for number in numbers:
        captures.append(opener(number))
        try:
            if not captures[-1].isOpened():
                raise DeviceError(f"cannot open {number!r}")
            _set_up(number, captures[-1], params)
        except DeviceError:
            _release(captures)
            raise
    return captures


def _set_up(number: int, capture: Any, params: DeviceParams) -> None:
    settings: dict[str, tuple[int, float]] = {}
    if params.exposure:
        units = math.log2(params.exposure) if params.exposure_log2 else params.exposure / 100e-6
        settings = {"manual exposure": (cv2.CAP_PROP_AUTO_EXPOSURE, 1.0), "exposure": (cv2.CAP_PROP_EXPOSURE, units)}
    if params.trigger:
        settings["trigger"] = (cv2.CAP_PROP_TRIGGER, 1.0)
    for name, (key, value) in settings.items():
        if not capture.set(key, value):
            raise DeviceError(f"device {number} takes no setting of {name}")


def _again(numbers: Sequence[int], params: DeviceParams, opener: Open) -> list[Any]:
    end = time.monotonic() + params.patience
    while True:
        try:
            return _open(numbers, params, opener)
        except DeviceError:
            if time.monotonic() > end:
                raise
            time.sleep(params.retry)


def _cut(image: np.ndarray, region: tuple[int, int, int, int]) -> np.ndarray:
    left, top, width, height = region
    if not any(region):
        return image
    if left + width > image.shape[1] or top + height > image.shape[0]:
        raise DeviceError(f"region = {list(region)} is outside an image of {image.shape[1]} x {image.shape[0]} pixels")
    return image[top : top + height, left : left + width]


def _release(captures: Sequence[Any]) -> None:
    for capture in captures:
        capture.release()
