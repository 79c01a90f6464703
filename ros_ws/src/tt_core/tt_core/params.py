"""Parameters with unit, meaning and range, declared in one place for checks, ROS descriptors, YAML files and the reference table."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import field, fields
from functools import cache
from typing import Any

from .errors import BadChoice, BadShape, TtError, check_range

_TYPES = {bool: "true or false", int: "an integer", float: "a number", str: "a text", tuple: "a list"}  # how errors call the types


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
    """Return a dataclass field that carries unit, meaning and range of a parameter in its metadata.

    Args:
        default: A bool, int, float, str, or a tuple of one of these.
        unit: SI symbol, or "" without a unit.
        meaning: What it does, and where the default comes from.
        low: Least value, of each element of a tuple.
        high: Largest value, of each element of a tuple.
        choices: The texts that are allowed; empty for any.
        dynamic: Whether a new value takes effect while the node runs.
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
        BadShape: A tuple of floats has another length than its default, unless that is empty.
    """
    kind: Any = type(params)
    for name, default, metadata in _fields(kind):
        check_value(name, getattr(params, name), default, metadata)


@cache
def _fields(kind: type) -> tuple[tuple[str, Any, Mapping[str, Any]], ...]:
    """Return name, default and metadata of the fields of a dataclass made by `param`; kept, because the arm checks some for each stroke."""
    return tuple((f.name, f.default, dict(f.metadata)) for f in fields(kind) if f.metadata)


def check_value(name: str, value: Any, default: Any, metadata: Mapping[str, Any]) -> None:
    """Check one value against the metadata of its field.

    Args:
        name: Name of the parameter in errors.
        value: The value.
        default: Default of the field, which gives the length of a tuple of floats; an empty one allows any length.
        metadata: Metadata that `param` has made.

    Raises:
        OutOfRange: A number, or an element of a tuple, is outside its range.
        NotFinite: A number is NaN or infinite.
        BadChoice: A text is none of the choices.
        BadShape: A tuple of floats has another length than its default.
    """
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


def coerce(name: str, value: Any, default: Any) -> Any:
    """Convert a value to the type of its default.

    An integer is converted where a float or a text is wanted (the text is its digits), a list where a tuple is wanted.

    Args:
        name: Name of the parameter in errors.
        value: The value.
        default: A value of the type that is wanted.

    Raises:
        TtError: The value is of another type.
    """
    kind = type(default)
    if kind is str and isinstance(value, int) and not isinstance(value, bool):
        return str(value)
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if kind is tuple and hasattr(value, "__len__") and not isinstance(value, (str, bytes)):
        return tuple(coerce(f"{name}[{i}]", v, default[0]) if default else v for i, v in enumerate(value))
    if not isinstance(value, kind):
        raise TtError(f"parameter {name} = {value!r}: wanted {_TYPES[kind]}, e.g. {list(default) if kind is tuple else default!r}")
    return value


def params_from_values(kind: Any, values: Mapping[str, Any], prefix: str = "") -> Any:
    """Return an instance of a dataclass of `param` fields with the values of a parameter file.

    Args:
        kind: The dataclass, or an instance of it that has the defaults.
        values: Values by full name. The default is used for a name that is missing or whose value is NaN.
        prefix: Put before the name of each field, e.g. "swing.".

    Raises:
        TtError: A value has the wrong type or is outside its range.
    """
    default = kind() if isinstance(kind, type) else kind
    found = {}
    for f in fields(default):
        name, standard = prefix + f.name, getattr(default, f.name)
        value = values.get(name)
        is_unset = value is None or (isinstance(value, float) and math.isnan(value))
        found[f.name] = standard if is_unset else coerce(name, value, standard)
        if f.metadata:
            check_value(name, found[f.name], f.default, f.metadata)
    return type(default)(**found)
