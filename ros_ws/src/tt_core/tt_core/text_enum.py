"""Enumerations whose values are the words that files, tables and diagnostics show."""

from __future__ import annotations

from enum import Enum


class TextEnum(str, Enum):
    """Base class of enumerations whose values are the words that files, tables and diagnostics show.

    It does the same as `enum.StrEnum`, which Python has from 3.11 on. Code decides on members. `str(member)` and `f"{member}"` give the
    word, and `Kind("the word")` gives the member of an enumeration Kind.
    """

    __str__ = str.__str__
    __format__ = str.__format__  # type: ignore[assignment]
