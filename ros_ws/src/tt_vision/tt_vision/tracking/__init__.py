"""Tracking of the ball over time from measured states of the ball, measured positions, and the pixels at which wide cameras see it.

`Tracker` is the class to use. It keeps the measurements of a window of time, the last 0.4 s or so, in order of their stamps (`history`),
fits one flight to them (`window_fit`), computes the ball at any time from the fit (`prediction`), and finds a ball for which there is no
measured state to start from (`cold_start`).
"""

from .params import TrackerParams
from .tracker import Tracker

__all__ = ["Tracker", "TrackerParams"]
