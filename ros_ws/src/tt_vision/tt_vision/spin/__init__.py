"""Estimation of the ball's spin from the marks, the printed or drawn dots on its surface."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..exports import lazy_exports

if TYPE_CHECKING:
    from ..measure import estimate_spin
    from .estimate import SpinEstimate, SpinReason
    from .registration import SearchParams

__all__ = ["SearchParams", "SpinEstimate", "SpinReason", "estimate_spin"]

__getattr__ = lazy_exports(
    __name__,
    {
        "estimate_spin": "tt_vision.measure",
        "SpinEstimate": "tt_vision.spin.estimate",
        "SpinReason": "tt_vision.spin.estimate",
        "SearchParams": "tt_vision.spin.registration",
    },
)
