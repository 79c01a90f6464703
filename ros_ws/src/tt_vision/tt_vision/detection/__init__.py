"""Detection of the ball in an image: its position, its outline and the light on it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..exports import lazy_exports

if TYPE_CHECKING:
    from .ball_detection import DetectionReason, NoWholeBall, ball_centre, detect_balls, find_ball
    from .illumination import CalibratedLamps, Illumination
    from .lens_correction import CannotUndistort, Lens, straighten
    from .outline import OUTLINE_POINT, scan_outline

__all__ = [
    "OUTLINE_POINT",
    "CalibratedLamps",
    "CannotUndistort",
    "DetectionReason",
    "Illumination",
    "Lens",
    "NoWholeBall",
    "ball_centre",
    "detect_balls",
    "find_ball",
    "scan_outline",
    "straighten",
]

__getattr__ = lazy_exports(
    __name__,
    {
        "DetectionReason": "tt_vision.detection.ball_detection",
        "NoWholeBall": "tt_vision.detection.ball_detection",
        "ball_centre": "tt_vision.detection.ball_detection",
        "detect_balls": "tt_vision.detection.ball_detection",
        "find_ball": "tt_vision.detection.ball_detection",
        "CalibratedLamps": "tt_vision.detection.illumination",
        "Illumination": "tt_vision.detection.illumination",
        "CannotUndistort": "tt_vision.detection.lens_correction",
        "Lens": "tt_vision.detection.lens_correction",
        "straighten": "tt_vision.detection.lens_correction",
        "OUTLINE_POINT": "tt_vision.detection.outline",
        "scan_outline": "tt_vision.detection.outline",
    },
)
