"""The ball over time from whatever sees it: a measured state, positions, or pixels of wide cameras.

`Tracker` is the facade. It fits one flight to the measurements of the last moments (`window_fit`), keeps them in order of their stamps
(`history`), and finds a ball that nothing announced (`cold_start`).
"""

from .params import TrackerParams
from .tracker import Tracker

__all__ = ["Tracker", "TrackerParams"]
