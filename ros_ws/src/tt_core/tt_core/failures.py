"""Reasons as values: an enumerated code with named numbers, which becomes a sentence where a person reads it."""

from __future__ import annotations

from enum import Enum
from typing import Any


class Failure:
    """Why something is not done, or not as asked.

    Attributes:
        code: Member of an enumeration whose values are format strings, e.g. "joint state is {age:.3f} s old".
        values: What the format string names.
    """

    __slots__ = ("code", "values")

    def __init__(self, code: Enum, **values: Any) -> None:
        """Keep the code and its values; nothing is formatted before somebody reads it."""
        self.code, self.values = code, values

    def __str__(self) -> str:
        """The sentence."""
        return str(self.code.value).format(**self.values)

    def __repr__(self) -> str:
        """Code and values."""
        return f"Failure({self.code}, {self.values})"
