"""The types of arrays, and the order of numbers in arrays that hold a state of the ball."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Triple = tuple[float, float, float]  # three components of a vector, in compiled functions that must allocate no memory
Image = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]  # (h, w) grey levels

# elements of a state (9,): position in m, velocity in m/s, spin in rad/s, frame `table`
X, Y, Z, VX, VY, VZ, WX, WY, WZ = range(9)
POSITION, VELOCITY, SPIN = slice(0, 3), slice(3, 6), slice(6, 9)

# columns of a path (n, 10): time in s, then a state
TIME, STATE = 0, slice(1, 10)
