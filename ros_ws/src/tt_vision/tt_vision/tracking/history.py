"""The measurements of the tracker's window of time, in order of their stamps."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from tt_core.states import Array

CAPACITY = 512  # largest number of measurements: 0.4 s of four cameras at 300 Hz
MEASURED_POSITION = -1  # in place of the index of a camera: the measurement is a position, not a pixel


class Measurements(NamedTuple):
    """Measurements of the ball as arrays, for compiled functions: pixels seen by cameras and measured positions.

    Attributes:
        times: (n,) s, stamps, not decreasing.
        cameras: (n,) index of the camera of a pixel; MEASURED_POSITION for a measured position.
        values: (n, 3) position in m in `table`; for a pixel its column, its row, and 0.
        roots: (n, 3, 3) inverse of the Cholesky factor of the covariance of a position, 1/m. For a pixel only [0, 0] is used, which is 1
            divided by its standard deviation in pixels.
        used: (n,) whether the fit uses the measurement; outliers are not used.
    """

    times: Array
    cameras: npt.NDArray[np.int64]
    values: Array
    roots: Array
    used: npt.NDArray[np.bool_]


def select(measurements: Measurements, which: Any) -> Measurements:
    """Return some of the measurements.

    Args:
        measurements: The measurements.
        which: Index of NumPy for the first axis that keeps this axis: a slice, or an array of integers or of bool. With a slice the result
            shares its memory with `measurements`.
    """
    m = measurements
    return Measurements(m.times[which], m.cameras[which], m.values[which], m.roots[which], m.used[which])


class History:
    """Holds up to CAPACITY measurements in order of their stamps.

    The order of measurements with equal stamps does not depend on the order in which they arrive.
    """

    def __init__(self) -> None:
        """Create an empty history."""
        self._size = 0
        self._all = Measurements(
            np.empty(CAPACITY),
            np.empty(CAPACITY, np.int64),
            np.empty((CAPACITY, 3)),
            np.empty((CAPACITY, 3, 3)),
            np.empty(CAPACITY, np.bool_),
        )

    @property
    def _arrays(self) -> tuple[npt.NDArray[Any], ...]:
        """The arrays of all measurements, each of length CAPACITY."""
        return tuple(self._all)

    def __len__(self) -> int:
        """Return the number of measurements."""
        return self._size

    @property
    def full(self) -> bool:
        """Whether there is no room for another measurement."""
        return self._size == CAPACITY

    @property
    def measurements(self) -> Measurements:
        """All measurements. The arrays are views of the history, which are valid until it changes."""
        return self.part(0, self._size)

    def part(self, first: int, last: int) -> Measurements:
        """Return the measurements with the indices `first` to `last` - 1, as views that are valid until the history changes."""
        return select(self._all, slice(first, last))

    def add(self, time: float, camera: int, value: Array, root: Array) -> bool:
        """Insert a measurement at its place in the order of stamps, with `used` False; the history must not be full.

        Args:
            time: Stamp, s.
            camera: Index of the camera; MEASURED_POSITION for a measured position.
            value: (3,), see `Measurements.values`.
            root: (3, 3), see `Measurements.roots`.

        Returns:
            Whether it was inserted; False if a measurement with the same stamp, camera and value is there already.
        """
        n, times = self._size, self._all.times
        at = int(np.searchsorted(times[:n], time, side="right"))
        while at > 0 and times[at - 1] == time:
            other, place = int(self._all.cameras[at - 1]), self._all.values[at - 1]
            if other == camera and (place == value).all():
                return False
            if (other, *place.tolist()) < (camera, *value.tolist()):
                break
            at -= 1
        for array in self._arrays:
            array[at + 1 : n + 1] = array[at:n]
        for array, item in zip(self._arrays, (time, camera, value, root, False), strict=True):
            array[at] = item
        self._size += 1
        return True

    def copy(self, first: int) -> History:
        """Return a new history with copies of the measurements from the index `first` on."""
        other = History()
        other._size = self._size - first
        for target, array in zip(other._arrays, self._arrays, strict=True):
            target[: other._size] = array[first : self._size]
        return other

    def drop(self, count: int) -> None:
        """Remove the oldest `count` measurements."""
        left = self._size - count
        for array in self._arrays:
            array[:left] = array[count : self._size]
        self._size = left

    def clear(self) -> None:
        """Remove all measurements."""
        self._size = 0
