"""Errors in configuration files as values: the file, the path of the wrong value in the file, and the cause."""

from __future__ import annotations

import reprlib
from typing import NamedTuple

from .errors import TtError


class Problem(NamedTuple):
    """One wrong value in a configuration file.

    Attributes:
        path: Where it is, e.g. "launcher.rate" or "scale[1]"; "" is the whole file.
        cause: The error, e.g. an OutOfRange, BadChoice, WrongType or UnknownKey, which hold the value and what is allowed.
    """

    path: str
    cause: Exception

    def __str__(self) -> str:
        """Return path and cause. The name of the value is left out of the cause where the cause has a name."""
        text, name = str(self.cause), getattr(self.cause, "name", None)
        if name is not None:
            text = text.removeprefix(name).removeprefix(" = ").removeprefix(" ")
        return f"{self.path}: {text}" if self.path else text


class BadFile(TtError):
    """A configuration file that cannot be used.

    Attributes:
        file: Its name.
        problems: All wrong values that were found.
    """

    def __init__(self, file: str, problems: tuple[Problem, ...]) -> None:
        """Store the arguments as attributes, so that code can use them."""
        super().__init__("\n".join(f"{file}: {problem}" for problem in problems))
        self.file, self.problems = file, problems


class WrongType(TtError):
    """A value in a configuration file that is of another type than its field."""

    def __init__(self, value: object, wanted: str) -> None:
        """Store the value and the name of the type that it must have."""
        super().__init__(f"{shown_value(value)} is not {wanted}")
        self.value, self.wanted = value, wanted


class UnknownKey(TtError):
    """A key in a configuration file that is no field of the dataclass."""

    def __init__(self, key: object, known: tuple[str, ...]) -> None:
        """Store the key and the names of all fields."""
        super().__init__(f"unknown, known are {', '.join(known)}")
        self.key, self.known = key, known


class MissingKey(TtError):
    """A field without a default that is missing in a configuration file."""

    def __init__(self, key: str) -> None:
        """Store the name of the field."""
        super().__init__("is missing")
        self.key = key


class Unreadable(TtError):
    """A configuration file that does not exist or is no valid YAML."""


class WrongContent(Exception):
    """All problems of one mapping in a configuration file. Their paths are relative to the mapping."""

    def __init__(self, problems: list[Problem]) -> None:
        """Store the problems."""
        super().__init__(problems)
        self.problems = problems


_SHORT = reprlib.Repr()
_SHORT.maxlevel = 2  # values may hold each other by aliases: 6 elements at each level are shown
_SHORT.maxstring = _SHORT.maxother = 60


def shown_value(value: object) -> str:
    """Return a value of any size as text, in bounded time and length."""
    try:
        return _SHORT.repr(value)
    except ValueError:  # Python refuses to write integers of more than 4,300 digits
        return "a number of thousands of digits"
