"""The measurements of the last moments, in order of their stamps."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from tt_core.states import Array

CAPACITY = 512  # measurements: 0.4 s of four cameras at 300 Hz
POSITION = -1  # in place of a camera: a position


class Measurements(NamedTuple):
    """Measurements as kernels take them.

    Attributes:
        times: (n,) s, not decreasing.
        cameras: (n,) index of the camera, or POSITION.
        values: (n, 3) position in m, or the pixel and 0.
        roots: (n, 3, 3) inverse of the Cholesky factor of the covariance; of a pixel only [0, 0] counts, 1 over its standard deviation.
        used: (n,) whether the fit uses it.
    """

    times: Array
    cameras: npt.NDArray[np.int64]
    values: Array
    roots: Array
    used: npt.NDArray[np.bool_]


def select(measurements: Measurements, which: Any) -> Measurements:
    """Return some of the measurements; which: any index of an array."""
    m = measurements
    return Measurements(m.times[which], m.cameras[which], m.values[which], m.roots[which], m.used[which])


class History:
    """Measurements in order of their stamps; equal stamps in an order that does not depend on that of their arrival."""

    def __init__(self) -> None:
        """Start empty."""
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
        """All arrays, of equal length."""
        return tuple(self._all)

    def __len__(self) -> int:
        """Return how many measurements there are."""
        return self._size

    @property
    def full(self) -> bool:
        """Whether there is no room for another one."""
        return self._size == CAPACITY

    @property
    def measurements(self) -> Measurements:
        """All measurements; the arrays are views, valid until the next change."""
        return self.part(0, self._size)

    def part(self, first: int, last: int) -> Measurements:
        """Return measurements `first` to `last` - 1 as views."""
        return select(self._all, slice(first, last))

    def add(self, time: float, camera: int, value: Array, root: Array) -> bool:
        """Insert a measurement, unused; return False if the same one is there already."""
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
        """Return a copy of the measurements from the index `first` on."""
        other = History()
        other._size = self._size - first
        for target, array in zip(other._arrays, self._arrays, strict=True):
            target[: other._size] = array[first : self._size]
        return other

    def drop(self, count: int) -> None:
        """Forget the oldest `count` measurements."""
        left = self._size - count
        for array in self._arrays:
            array[:left] = array[count : self._size]
        self._size = left

    def clear(self) -> None:
        """Forget all."""
        self._size = 0
