"""Parameters with unit, meaning and range, written once: checks, ROS descriptors, YAML and the reference table come from them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field, fields
from typing import Any

from .errors import BadChoice, BadShape, check_range


def param(
    default: Any,
    unit: str,
    meaning: str,
    *,
    low: float = -math.inf,
    high: float = math.inf,
    choices: tuple[str, ...] = (),
    dynamic: bool = False,
) -> Any:
    """Return a dataclass field that knows its unit, meaning and range.

    Args:
        default: A bool, int, float, str, or a tuple of one of these.
        unit: SI symbol, or "" without a unit.
        meaning: What it does, and where the default comes from.
        low: Least value, of each element of a tuple.
        high: Largest value, of each element of a tuple.
        choices: The texts that are allowed; empty for any.
        dynamic: Whether it acts when it is set while the node runs.
    """
    return field(
        default=default, metadata={"unit": unit, "meaning": meaning, "low": low, "high": high, "choices": choices, "dynamic": dynamic}
    )


def check(params: Any) -> None:
    """Check every field of a dataclass against its metadata.

    Raises:
        OutOfRange: A number, or an element of a tuple, is outside its range.
        NotFinite: A number is NaN or infinite.
        BadChoice: A text is none of the choices.
        BadShape: A tuple of numbers has another length than its default, unless that is empty.
    """
    for f in fields(params):
        if f.metadata:
            check_value(f.name, getattr(params, f.name), f.default, f.metadata)


def check_value(name: str, value: Any, default: Any, metadata: Mapping[str, Any]) -> None:
    """Check one value against the metadata of its field; raises as `check` does, with `name` in the error."""
    if isinstance(value, (tuple, list)):
        if default and isinstance(default[0], float) and len(value) != len(default):
            raise BadShape(name, (len(value),), (len(default),))
        for i, element in enumerate(value):
            check_value(f"{name}[{i}]", element, element, metadata)
    elif isinstance(value, str):
        if metadata["choices"] and value not in metadata["choices"]:
            raise BadChoice(name, value, metadata["choices"])
    elif not isinstance(value, bool):
        check_range(name, value, metadata["low"], metadata["high"])
