"""The spin of the ball from its surface."""

from .estimate import SpinEstimate, estimate_spin

__all__ = ["SpinEstimate", "estimate_spin"]
