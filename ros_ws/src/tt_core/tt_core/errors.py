"""Errors of the robot. Each error holds the wrong value and the bound that it breaks."""

from __future__ import annotations

import math
from typing import Any

import numpy as np


class TtError(ValueError):
    """Base class of all errors that the packages of this workspace raise."""


class OutOfRange(TtError):
    """A number outside its bounds."""

    def __init__(self, name: str, value: float, low: float, high: float) -> None:
        """Store the arguments as attributes, so that code can use them.

        Args:
            name: What the number is called in the message.
            value: The number.
            low: Least value allowed.
            high: Largest value allowed.
        """
        super().__init__(f"{name} = {value:g} is outside [{low:g}, {high:g}]")
        self.name, self.value, self.low, self.high = name, value, low, high


class BadShape(TtError):
    """An array that has another shape than it must have."""

    def __init__(self, name: str, shape: tuple[int, ...], wanted: object) -> None:
        """Store the arguments as attributes, so that code can use them.

        Args:
            name: What the array is called in the message.
            shape: Its shape.
            wanted: The shape that it must have, or a description of it.
        """
        super().__init__(f"{name} has shape {shape}, wanted {wanted}")
        self.name, self.shape, self.wanted = name, shape, wanted


class NotFinite(TtError):
    """A NaN or an infinity where a number is needed."""

    def __init__(self, name: str, value: Any) -> None:
        """Store the arguments as attributes: what the value is called in the message, and the value."""
        super().__init__(f"{name} = {np.array2string(np.asarray(value), threshold=20)} is not finite")
        self.name, self.value = name, value


class BadChoice(TtError):
    """A text that is not one of the allowed texts."""

    def __init__(self, name: str, value: str, choices: tuple[str, ...]) -> None:
        """Store the arguments as attributes, so that code can use them.

        Args:
            name: What the text is called in the message.
            value: The text.
            choices: The allowed texts.
        """
        super().__init__(f"{name} = {value!r} is none of {', '.join(map(repr, choices))}")
        self.name, self.value, self.choices = name, value, choices


class BadMessage(TtError):
    """A ROS message whose content is not of the form that its topic must have."""


def check_choice(name: str, value: str, choices: tuple[str, ...]) -> str:
    """Return `value` if it is one of `choices`.

    Args:
        name: What the text is called in errors.
        value: The text.
        choices: The allowed texts.

    Raises:
        BadChoice: `value` is none of them.
    """
    if value not in choices:
        raise BadChoice(name, value, choices)
    return value


def check_range(name: str, value: float, low: float, high: float) -> float:
    """Check a number.

    Args:
        name: What the number is called in errors.
        value: The number.
        low: Least value allowed.
        high: Largest value allowed.

    Returns:
        `value` as float.

    Raises:
        NotFinite: It is NaN or infinite.
        OutOfRange: It is below `low` or above `high`.
    """
    value = float(value)
    if not math.isfinite(value):
        raise NotFinite(name, value)
    if not low <= value <= high:
        raise OutOfRange(name, value, low, high)
    return value


def check_array(name: str, value: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Check an array.

    Args:
        name: What the array is called in errors.
        value: The array, or nested lists of numbers.
        shape: The shape wanted; -1 stands for any length.

    Returns:
        A read-only float64 copy of `value`.

    Raises:
        BadShape: It has another shape.
        NotFinite: A number is NaN or infinite.
        TtError: It does not consist of numbers, or its rows differ in length.
    """
    try:
        array = np.array(value, dtype=np.float64)
    except (ValueError, TypeError) as error:
        raise TtError(f"{name} is no array of numbers: {error}") from error
    if array.shape != shape and not (
        array.ndim == len(shape) and all(want in (-1, have) for have, want in zip(array.shape, shape, strict=True))
    ):
        raise BadShape(name, array.shape, shape)
    # for a few numbers the plain loop is faster than numpy's
    if not (all(map(math.isfinite, array.tolist())) if array.ndim == 1 and len(array) < 10 else np.isfinite(array).all()):
        raise NotFinite(name, array)
    array.flags.writeable = False
    return array
