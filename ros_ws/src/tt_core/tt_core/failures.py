"""Reasons for failures as values: an enumerated code with named numbers, and a sentence for people that is made when it is needed."""

from __future__ import annotations

from enum import Enum
from typing import Any


class Failure:
    """Reason why something is not done, or is done in another way than it was asked for.

    Code decides on `code` and on `values`, never on the sentence. `str(failure)` makes the sentence.

    Attributes:
        code: Member of an enumeration whose values are format strings, e.g. TOO_OLD = "joint state is {age:.3f} s old".
        values: The numbers and names that the format string needs, by name, in SI units.
    """

    __slots__ = ("code", "values")

    def __init__(self, code: Enum, **values: Any) -> None:
        """Store the code, and the values for its format string."""
        self.code, self.values = code, values

    def __str__(self) -> str:
        """Return the sentence."""
        return str(self.code.value).format(**self.values)

    def __repr__(self) -> str:
        """Return code and values."""
        return f"Failure({self.code}, {self.values})"

    def __eq__(self, other: object) -> bool:
        """Tell whether code and values are the same."""
        return isinstance(other, Failure) and (self.code, self.values) == (other.code, other.values)

    def __hash__(self) -> int:
        """Hash the code; values may be of any type."""
        return hash(self.code)


def code_name(failure: Failure | None) -> str:
    """Return the name of the code of a failure, "NONE" without one; a state tells so that its trouble is over."""
    return "NONE" if failure is None else failure.code.name
