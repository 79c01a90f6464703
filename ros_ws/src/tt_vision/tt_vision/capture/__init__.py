"""From cameras, files and topics to bursts.

A burst holds the images of one ball's passage through the high speed cameras (about six pairs).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..exports import lazy_exports

if TYPE_CHECKING:
    from .assembler import Assembler, AssemblerCounts, BurstParams
    from .burst import BallDetection, Burst, TimesNotRising
    from .devices import DeviceCounts, DeviceError, DeviceParams, DeviceReason, grabs
    from .sources import Calibration, SourceError, SourceParams, StampedImage, calibrations, read_images

__all__ = [
    "Assembler",
    "AssemblerCounts",
    "BallDetection",
    "Burst",
    "BurstParams",
    "Calibration",
    "DeviceCounts",
    "DeviceError",
    "DeviceParams",
    "DeviceReason",
    "SourceError",
    "SourceParams",
    "StampedImage",
    "TimesNotRising",
    "calibrations",
    "grabs",
    "read_images",
]

__getattr__ = lazy_exports(
    __name__,
    {
        "Assembler": "tt_vision.capture.assembler",
        "AssemblerCounts": "tt_vision.capture.assembler",
        "BurstParams": "tt_vision.capture.assembler",
        "BallDetection": "tt_vision.capture.burst",
        "Burst": "tt_vision.capture.burst",
        "TimesNotRising": "tt_vision.capture.burst",
        "DeviceCounts": "tt_vision.capture.devices",
        "DeviceError": "tt_vision.capture.devices",
        "DeviceParams": "tt_vision.capture.devices",
        "DeviceReason": "tt_vision.capture.devices",
        "grabs": "tt_vision.capture.devices",
        "Calibration": "tt_vision.capture.sources",
        "SourceError": "tt_vision.capture.sources",
        "SourceParams": "tt_vision.capture.sources",
        "StampedImage": "tt_vision.capture.sources",
        "calibrations": "tt_vision.capture.sources",
        "read_images": "tt_vision.capture.sources",
    },
)
