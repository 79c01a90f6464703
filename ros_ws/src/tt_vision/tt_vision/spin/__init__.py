"""The spin of the ball from its surface."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..measure import estimate_spin
    from .estimate import SpinEstimate, SpinReason
    from .registration import SearchParams

__all__ = ["SearchParams", "SpinEstimate", "SpinReason", "estimate_spin"]

_HOME = {
    "SearchParams": "tt_vision.spin.registration",
    "SpinEstimate": "tt_vision.spin.estimate",
    "SpinReason": "tt_vision.spin.estimate",
    "estimate_spin": "tt_vision.measure",
}


def __getattr__(name: str) -> Any:
    """Import what is exported when it is first used: the measurement imports the stages of this package."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
