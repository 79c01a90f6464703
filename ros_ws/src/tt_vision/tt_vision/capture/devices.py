"""Cameras that the operating system knows, through OpenCV: set up by parameters, stamped when they grab, opened again when lost."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

import cv2
import numpy as np
from tt_core.errors import TtError
from tt_core.params import check, param


class DeviceReason(Enum):
    """Why a device is not used: codes of `tt_core.failures.Failure`."""

    CANNOT_OPEN = "cannot open {device!r}"
    NO_SETTING = "device {device} takes no setting of {setting}"
    OTHER_SIZE = "device {device} sends {width} x {height} pixels, before {width_before} x {height_before}"
    BAD_REGION = "region = {region} is not left, top, width, height with at least 8 x 8 pixels, or all 0"
    REGION_OUTSIDE = "region = {region} is outside an image of {width} x {height} pixels"


class DeviceError(TtError):
    """A device that cannot be opened, does not take a setting, or changes its images; its failure has a code of DeviceReason."""


@dataclass(frozen=True)
class DeviceParams:
    """How both cameras are set up."""

    exposure: float = param(0.0, "s", "exposure time; 0 leaves it as the driver has it", low=0.0, high=1.0)
    exposure_log2: bool = param(
        False, "", "whether the driver takes the exposure as log2 of seconds (DirectShow) instead of in units of 100 us (V4L2)"
    )
    trigger: bool = param(False, "", "whether each frame waits for the trigger input")
    region: tuple[int, int, int, int] = param(
        (0, 0, 0, 0), "pixels", "part of the image that is published: left, top, width, height; all 0: the whole image", low=0, high=65535
    )
    retry: float = param(1.0, "s", "time between two attempts to open a lost device again", low=0.0, high=60.0)
    patience: float = param(60.0, "s", "time for which a lost device is tried again before it is given up", low=0.0, high=86400.0)

    def __post_init__(self) -> None:
        """Refuse values outside their range, and a region of less than 8 x 8 pixels."""
        check(self)
        if len(self.region) != 4 or min(self.region) < 0 or (any(self.region) and min(self.region[2:]) < 8):
            raise DeviceError(DeviceReason.BAD_REGION, region=list(self.region))


@dataclass
class DeviceCounts:
    """What went wrong since the start.

    Attributes:
        dropped: Frames that are missing by the stamps.
        lost: How often the devices were opened again.
    """

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
    """Grab frames of all devices together.

    Args:
        numbers: Of the devices.
        now: Returns the time, s. A frame is stamped when it is grabbed, before anything is decoded, less half of the exposure.
        params: How the devices are set up.
        frame_rate: 1/s, to count the frames that the devices drop.
        counts: Takes these numbers.
        opener: Opens a device by its number.

    Yields:
        The time, s, and the image of each device as it comes.

    Raises:
        DeviceError: A device cannot be opened at the start, or for `patience`, does not take a setting, or changes the size of its images.
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
                captures = _reopen(numbers, params, opener)
                counts.lost += 1
                last = None
                continue
            images = [_cut(image, params.region) for _, image in taken]
            shapes = shapes or [image.shape[:2] for image in images]
            for number, image, shape in zip(numbers, images, shapes, strict=True):
                if image.shape[:2] != shape:
                    (height, width), (height_before, width_before) = image.shape[:2], shape
                    raise DeviceError(
                        DeviceReason.OTHER_SIZE,
                        device=number,
                        width=width,
                        height=height,
                        width_before=width_before,
                        height_before=height_before,
                    )
            if last is not None:
                counts.dropped += max(0, round((at - last) * frame_rate) - 1)
            last = at
            yield at - 0.5 * params.exposure, images
    finally:
        _release(captures)


def _open(numbers: Sequence[int], params: DeviceParams, opener: Open) -> list[Any]:
    """Open and set up all devices; if one fails, release the others and raise DeviceError."""
    captures = []
    for number in numbers:
        captures.append(opener(number))
        try:
            if not captures[-1].isOpened():
                raise DeviceError(DeviceReason.CANNOT_OPEN, device=number)
            _set_up(number, captures[-1], params)
        except DeviceError:
            _release(captures)
            raise
    return captures


def _set_up(number: int, capture: Any, params: DeviceParams) -> None:
    """Give a device its settings; raises DeviceError for one that it does not take."""
    settings: dict[str, tuple[int, float]] = {}
    if params.exposure:
        units = math.log2(params.exposure) if params.exposure_log2 else params.exposure / 100e-6
        settings = {"manual exposure": (cv2.CAP_PROP_AUTO_EXPOSURE, 1.0), "exposure": (cv2.CAP_PROP_EXPOSURE, units)}
    if params.trigger:
        settings["trigger"] = (cv2.CAP_PROP_TRIGGER, 1.0)
    for name, (key, value) in settings.items():
        if not capture.set(key, value):
            raise DeviceError(DeviceReason.NO_SETTING, device=number, setting=name)


def _reopen(numbers: Sequence[int], params: DeviceParams, opener: Open) -> list[Any]:
    """Open the devices, again and again until it succeeds or `patience` is over."""
    end = time.monotonic() + params.patience
    while True:
        try:
            return _open(numbers, params, opener)
        except DeviceError:
            if time.monotonic() > end:
                raise
            time.sleep(params.retry)


def _cut(image: np.ndarray, region: tuple[int, int, int, int]) -> np.ndarray:
    """Return the region of an image; raises DeviceError if it is outside."""
    left, top, width, height = region
    if not any(region):
        return image
    if left + width > image.shape[1] or top + height > image.shape[0]:
        raise DeviceError(DeviceReason.REGION_OUTSIDE, region=list(region), width=image.shape[1], height=image.shape[0])
    return image[top : top + height, left : left + width]


def _release(captures: Sequence[Any]) -> None:
    for capture in captures:
        capture.release()
