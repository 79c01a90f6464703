"""Position, velocity and spin of the ball from two high speed cameras, and the path of the ball from wide cameras.

The measurement follows Chapter 2 of the Nagoya dissertation "Racket Control and Spinning Ball Measurement for Table Tennis Robot".
`tt_vision.measure.measure` measures a ball from images, `tt_vision.measure.measure_burst` from a burst: the images of one ball's passage
through the high speed cameras (about six pairs). `tt_vision.calibrate` is the command that calibrates a camera.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from .exports import lazy_exports

if TYPE_CHECKING:
    from .camera import Camera, triangulate
    from .detection.illumination import CalibratedLamps
    from .measure import Measurement, MeasurementReason, estimate_spin
    from .spin.estimate import SpinEstimate
    from .spin.registration import SearchParams

__all__ = [
    "CalibratedLamps",
    "Camera",
    "Measurement",
    "MeasurementReason",
    "SearchParams",
    "SpinEstimate",
    "estimate_spin",
    "triangulate",
]

__getattr__ = lazy_exports(
    __name__,
    {
        "Camera": "tt_vision.camera",
        "triangulate": "tt_vision.camera",
        "CalibratedLamps": "tt_vision.detection.illumination",
        "Measurement": "tt_vision.measure",
        "MeasurementReason": "tt_vision.measure",
        "estimate_spin": "tt_vision.measure",
        "SpinEstimate": "tt_vision.spin.estimate",
        "SearchParams": "tt_vision.spin.registration",
    },
)
