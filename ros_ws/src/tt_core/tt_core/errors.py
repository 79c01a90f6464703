"""Errors of the robot. Each error holds the wrong value and the bound that it breaks."""

from __future__ import annotations

import math
from enum import Enum
from typing import Any

import numpy as np

from .failures import Failure


class ValueFailure(Enum):
    """Why a value is refused."""

    OUT_OF_RANGE = "{name} = {value:g} is outside [{low:g}, {high:g}]"
    BAD_SHAPE = "{name} has shape {shape}, wanted {wanted}"
    NOT_FINITE = "{name} = {value} is not finite"
    BAD_CHOICE = "{name} = {value!r} is none of {choices}"
    DECREASING = "{name} must not be empty and must not decrease"
    NO_NUMBERS = "{name} is no array of numbers: {error}"
    OTHER = "{text}"  # of an error that has no code of its own


class TtError(ValueError):
    """Base of all errors raised here.

    Attributes:
        failure: What is wrong; its sentence is the text of the error.
    """

    def __init__(self, what: Enum | str, **values: Any) -> None:
        """Keep what is wrong, so that a caller can decide on it.

        Args:
            what: Its code, or a sentence where only a person decides.
            values: What the format string of the code needs.
        """
        self.failure = Failure(what, **values) if isinstance(what, Enum) else Failure(ValueFailure.OTHER, text=what)
        super().__init__(str(self.failure))


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
        super().__init__(ValueFailure.OUT_OF_RANGE, name=name, value=value, low=low, high=high)
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
        super().__init__(ValueFailure.BAD_SHAPE, name=name, shape=shape, wanted=wanted)
        self.name, self.shape, self.wanted = name, shape, wanted


class NotFinite(TtError):
    """A NaN or an infinity where a number is needed."""

    def __init__(self, name: str, value: Any) -> None:
        """Store the arguments as attributes: what the value is called in the message, and the value."""
        super().__init__(ValueFailure.NOT_FINITE, name=name, value=np.array2string(np.asarray(value), threshold=20))
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
        super().__init__(ValueFailure.BAD_CHOICE, name=name, value=value, choices=", ".join(map(repr, choices)))
        self.name, self.value, self.choices = name, value, choices


class MessageFailure(Enum):
    """Why a message is refused."""

    TOO_LARGE = "message on {topic} has {size} bytes, at most {most} are read"
    UNREADABLE = "message on {topic} cannot be read: {error}"
    BAD_STAMP = "stamp of {sec} s and {nanosec} ns has more than a second of nanoseconds"
    OTHER_FRAME = "frame {wanted} expected, got {frame!r}"
    # balls
    NEGATIVE_VARIANCE = "{name} has the negative variance {variance:g}"
    NOT_SYMMETRIC = "{name} is not symmetric: its halves differ by {difference:g}"
    NEGATIVE_EIGENVALUE = "{name} is not positive semidefinite: it has the eigenvalue {eigenvalue:g}"
    # paths, goals and strokes
    OTHER_JOINT = "1 joint, {wanted}, expected, got {count}: {joints}"
    INCOMPLETE_POINT = "each point must hold one transform and one velocity"
    NO_ROTATION = "quaternion of length 1 expected, got {quaternion}"
    # joint states
    JOINT_COUNT = "each joint once expected, got {counts}"
    NUMBER_COUNT = "{field} holds {count} numbers for {names} names"
    # cameras
    NOT_CALIBRATED = "camera of {width} x {height} pixels is not calibrated: K = {matrix}"
    SKEWED = "K = {matrix} is skewed: it must be fx, 0, cx, 0, fy, cy, 0, 0, 1"
    BINNED = "binning of {x} x {y} pixels is not supported"
    OTHER_MODEL = "distortion model {model!r} is none of {known}"
    COEFFICIENT_COUNT = "distortion model {model!r} has {known} coefficients, got {count}"
    # images
    OTHER_ENCODING = "encoding {encoding!r} is none of {known}"
    OTHER_TYPE = "image of dtype uint8 or uint16 expected, got {dtype}"
    SMALL_STEP = "step = {step} bytes, a row of {width} pixels in {encoding} needs {needed}"
    OTHER_LENGTH = "{size} bytes of step {step} are no {width} x {height} {encoding}, which has {needed}"


class BadMessage(TtError):
    """A message whose content is not what its topic carries; its failure has a code of MessageFailure."""


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
        raise TtError(ValueFailure.NO_NUMBERS, name=name, error=error) from error
    if array.shape != shape and not (
        array.ndim == len(shape) and all(want in (-1, have) for have, want in zip(array.shape, shape, strict=True))
    ):
        raise BadShape(name, array.shape, shape)
    # for a few numbers the plain loop is faster than numpy's
    if not (all(map(math.isfinite, array.tolist())) if array.ndim == 1 and len(array) < 10 else np.isfinite(array).all()):
        raise NotFinite(name, array)
    array.flags.writeable = False
    return array
