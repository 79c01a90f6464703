"""The five racket states that the dissertation prints, with the positions of its text."""

import numpy as np
from tt_core.states import RacketState

_PRINTED = (
    ("Table 4.3, 1", (-0.15, 0.70, 0.25), (1.48, 0.095, 1.41), -0.011, 0.792),
    ("Table 4.3, 2", (-0.15, 0.70, 0.25), (0.65, 0.064, 1.72), -0.012, 1.66),
    ("Table 4.3, 3", (-0.15, 0.70, 0.25), (1.48, 0.23, 1.30), 0.31, 1.25),
    ("Table 4.5, backspin", (-0.30, 0.66, 0.23), (1.26, -0.18, 1.75), -0.068, 0.708),
    ("Table 4.5, topspin", (-0.14, 0.73, 0.26), (1.15, 0.019, 0.64), -0.028, 1.814),
)
# where the reference table lets the arm wait; the arm itself waits where it has most time for the strokes that it plays
REFERENCE_WAITING = tuple(np.radians([-73.0, 58.0, 62.0, 104.0, -11.0, 85.0, 144.0]).tolist())
NAMES = tuple(row[0] for row in _PRINTED)


def printed(time: float) -> list[RacketState]:
    """With the strike at `time` (s)."""
    return [RacketState(time, np.array(p), np.array(v), alpha, beta) for _, p, v, alpha, beta in _PRINTED]
