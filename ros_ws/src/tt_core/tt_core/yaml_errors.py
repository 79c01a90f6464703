"""What can be wrong with a configuration file, as values: the file, the path in it and the cause."""

from __future__ import annotations

import reprlib
from typing import NamedTuple

from .errors import TtError


class Problem(NamedTuple):
    """One wrong value of a file.

    Attributes:
        path: Where it is, e.g. "launcher.rate" or "scale[1]"; "" is the whole file.
        cause: What is wrong with it; OutOfRange, BadChoice, NotFinite and those below carry value and bound.
    """

    path: str
    cause: Exception

    def __str__(self) -> str:
        """Return path and cause, the name in the cause left out where the path ends with it."""
        text, name = str(self.cause), getattr(self.cause, "name", None)
        if name is not None:
            text = text.removeprefix(name).removeprefix(" = ").removeprefix(" ")
        return f"{self.path}: {text}" if self.path else text


class BadFile(TtError):
    """A file that cannot be used.

    Attributes:
        file: Its name.
        problems: Every wrong value.
    """

    def __init__(self, file: str, problems: tuple[Problem, ...]) -> None:
        """Keep file and problems, so that a caller can decide on them."""
        super().__init__("\n".join(f"{file}: {problem}" for problem in problems))
        self.file, self.problems = file, problems


class WrongType(TtError):
    """A value of another type than its field has."""

    def __init__(self, value: object, wanted: str) -> None:
        """Keep the value and the name of the wanted type."""
        super().__init__(f"{shown(value)} is not {wanted}")
        self.value, self.wanted = value, wanted


class UnknownKey(TtError):
    """A key that is no field."""

    def __init__(self, key: object, known: tuple[str, ...]) -> None:
        """Keep the key and the keys that there are."""
        super().__init__(f"unknown, known are {', '.join(known)}")
        self.key, self.known = key, known


class MissingKey(TtError):
    """A field without a default that is not in the file."""

    def __init__(self, key: str) -> None:
        """Keep the key."""
        super().__init__("is missing")
        self.key = key


class Unreadable(TtError):
    """A file that is not there, or no YAML."""


class WrongContent(Exception):
    """The problems of one mapping, their paths relative to it."""

    def __init__(self, problems: list[Problem]) -> None:
        """Keep the problems."""
        super().__init__(problems)
        self.problems = problems


_SHORT = reprlib.Repr()
_SHORT.maxlevel = 2  # values may hold each other by aliases: 6 elements at each level are shown
_SHORT.maxstring = _SHORT.maxother = 60


def shown(value: object) -> str:
    """Return a value of any size as text, in bounded time and length."""
    try:
        return _SHORT.repr(value)
    except ValueError:  # Python refuses to write integers of more than 4,300 digits
        return "a number of thousands of digits"
