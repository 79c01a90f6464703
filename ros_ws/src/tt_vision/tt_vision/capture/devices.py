"""Images from camera devices of the operating system, through OpenCV.

The devices are set up by parameters, a frame is stamped when it is grabbed, and a device that is lost is opened again.
"""

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
    """Reasons why a camera device cannot be used; codes of `tt_core.failures.Failure`, the values are format strings."""

    CANNOT_OPEN = "cannot open {device!r}"
    NO_SETTING = "device {device} takes no setting of {setting}"
    OTHER_SIZE = "device {device} sends {width} x {height} pixels, before {width_before} x {height_before}"
    BAD_REGION = "region = {region} is not left, top, width, height with at least 8 x 8 pixels, or all 0"
    REGION_OUTSIDE = "region = {region} is outside an image of {width} x {height} pixels"


class DeviceError(TtError):
    """A device that cannot be opened, does not take a setting, or changes its images; its failure has a code of DeviceReason."""


@dataclass(frozen=True)
class DeviceParams:
    """Settings of the two camera devices."""

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
        """Raise an error for a value outside its range, and for a region of less than 8 x 8 pixels."""
        check(self)
        if len(self.region) != 4 or min(self.region) < 0 or (any(self.region) and min(self.region[2:]) < 8):
            raise DeviceError(DeviceReason.BAD_REGION, region=list(self.region))


@dataclass
class DeviceCounts:
    """Counts of the faults of the camera devices since the start.

    Attributes:
        dropped: Number of frames that are missing, as the gaps between the stamps tell.
        lost: How often the devices were lost and opened again.
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
    """Open camera devices and grab frames of all of them together, without end.

    Args:
        numbers: Numbers of the devices, as OpenCV counts them.
        now: Returns the present time, s. It is called when a frame is grabbed, before the images are decoded.
        params: Settings of the devices.
        frame_rate: Frames per second, by which dropped frames are counted.
        counts: Counts of faults, increased in place.
        opener: Opens a device by its number.

    Yields:
        The time of each frame, s (the middle of the exposure), and one image per device, grey or in colour as OpenCV decodes it.

    Raises:
        DeviceError: A device cannot be opened at the start, or a lost one cannot be opened within `patience`. Or it does not accept a
            setting, its images change in size, or the region is outside its images.
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
    """Open and set up all devices; if one fails, release those that are open and raise DeviceError."""
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
    """Set exposure and trigger of a device; raise DeviceError for a setting that it does not accept."""
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
    """Open the devices; try again until they open, or raise DeviceError when `params.patience` is over."""
    end = time.monotonic() + params.patience
    while True:
        try:
            return _open(numbers, params, opener)
        except DeviceError:
            if time.monotonic() > end:
                raise
            time.sleep(params.retry)


def _cut(image: np.ndarray, region: tuple[int, int, int, int]) -> np.ndarray:
    """Return the part of an image inside a region (left, top, width, height); raise DeviceError if the region is outside the image."""
    left, top, width, height = region
    if not any(region):
        return image
    if left + width > image.shape[1] or top + height > image.shape[0]:
        raise DeviceError(DeviceReason.REGION_OUTSIDE, region=list(region), width=image.shape[1], height=image.shape[0])
    return image[top : top + height, left : left + width]


def _release(captures: Sequence[Any]) -> None:
    for capture in captures:
        capture.release()
