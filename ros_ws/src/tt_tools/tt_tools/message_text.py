"""Convert messages to YAML and CSV, and values in YAML to messages, by the conventions of rosidl_runtime_py."""

from __future__ import annotations

import array
import sys
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import yaml
from rosidl_parser.definition import AbstractNestedType, AbstractString, AbstractWString, Array, BasicType, BoundedSequence, NamespacedType
from tt_core.errors import TtError

from .packages import interface

SEQUENCE_TYPES = (list, tuple, array.array, np.ndarray)
FLOATS = ("float", "double", "long double")
HEADER_TYPE, TIME_TYPE = "std_msgs/msg/Header", "builtin_interfaces/msg/Time"


class FieldError(TtError):
    """Error: values do not fit a message type.

    Attributes:
        field: Name of the field, after the fields that it is nested in, e.g. "header.stamp"; "" for the whole message.
    """

    def __init__(self, field: str, reason: object) -> None:
        """Keep the field, and make the error message from it and the reason."""
        super().__init__(f"Failed to populate field: {field}: {reason}" if field else f"Failed to populate field: {reason}")
        self.field = field


class TextOptions(NamedTuple):
    """How messages are written as text.

    Attributes:
        truncate: Most elements of an array and most characters of a string that are written; None for all.
        arrays: Whether the elements of arrays are written; if not, their type and length are.
        strings: Whether strings are written; if not, their length is.
        flow: Whether YAML is written in flow style, as {a: 1, b: 2}.
    """

    truncate: int | None = None
    arrays: bool = True
    strings: bool = True
    flow: bool = False


WHOLE_TEXT = TextOptions()


def to_plain(message: Any, options: TextOptions = WHOLE_TEXT) -> dict[str, Any]:
    """Return a message as nested dictionaries, lists, numbers and strings, shortened as the options tell."""
    names = message.get_fields_and_field_types()
    return {name: _plain(getattr(message, name), kind, options) for name, kind in zip(names, message.SLOT_TYPES, strict=True)}


def _plain(value: Any, kind: Any, options: TextOptions) -> Any:
    if isinstance(value, bytes):
        return _cut(value.decode("latin-1"), options)
    if isinstance(value, str):
        return _cut(value, options) if options.strings else f"<string length: <{len(value)}>>"
    if isinstance(value, SEQUENCE_TYPES):
        if not options.arrays and kind is not None:
            return _abbreviated(value, kind)
        shown = value if options.truncate is None else value[: options.truncate]
        return [_plain(item, None, options) for item in shown] + ["..."] * (len(shown) < len(value))
    if isinstance(value, np.generic):
        return value.item()
    return value if isinstance(value, (bool, int, float)) else to_plain(value, options)


def _cut(text: str, options: TextOptions) -> str:
    return text if options.truncate is None or len(text) <= options.truncate else text[: options.truncate] + "..."


def _abbreviated(value: Any, kind: AbstractNestedType) -> str:
    element = kind.value_type
    if isinstance(element, AbstractString):
        name = "string"
    elif isinstance(element, AbstractWString):
        name = "wstring"
    else:
        name = "/".join(element.namespaced_name()) if isinstance(element, NamespacedType) else element.typename
    if isinstance(kind, Array):
        return f"<array type: {name}[{kind.size}]>"
    bound = f"[{kind.maximum_size}]" if isinstance(kind, BoundedSequence) else ""
    return f"<sequence type: {name}{bound}, length: {len(value)}>"


def to_yaml(message: Any, options: TextOptions = WHOLE_TEXT) -> str:
    """Return a message as YAML text, with one line for each value unless `options.flow` is set."""
    return str(
        yaml.safe_dump(to_plain(message, options), sort_keys=False, allow_unicode=True, width=sys.maxsize, default_flow_style=options.flow)
    )


def to_csv(message: Any, options: TextOptions = WHOLE_TEXT) -> str:
    """Return the values of a message in the order of its fields, separated by commas."""

    def values(value: Any) -> list[str]:
        if isinstance(value, dict):
            return [text for item in value.values() for text in values(item)]
        if isinstance(value, list):
            return [text for item in value for text in values(item)]
        return [str(value)]

    return ",".join(values(to_plain(message, options)))


def message_from_values(message_type: Any, values: Any, now: Any = None) -> Any:
    """Return a message whose fields are set to given values.

    Args:
        message_type: Class of the message.
        values: Mapping of field names to values, nested as the message is. Fields that are not named keep their default values.
        now: Time message by which "auto" in place of a header and "now" in place of a time are replaced; None if both are not allowed.

    Raises:
        FieldError: The message has no such field, or the field does not take its value.
    """
    return _filled(message_type, values, now, "")


def _filled(message_type: Any, values: Any, now: Any, path: str) -> Any:
    if not isinstance(values, Mapping):
        raise FieldError(path.rstrip("."), f"{values!r} is no mapping of fields")
    message = message_type(check_fields=True)
    kinds = dict(zip(message.get_fields_and_field_types(), message.SLOT_TYPES, strict=True))
    for name, value in values.items():
        if name not in kinds:
            raise FieldError(f"{path}{name}", f"not a field of {message_type.__name__}, which has {', '.join(kinds) or 'none'}")
        made = _made(kinds[name], value, now, f"{path}{name}")
        try:
            setattr(message, name, made)
        except (AssertionError, TypeError, ValueError, OverflowError) as error:
            raise FieldError(f"{path}{name}", error) from error
    return message


def _made(kind: Any, value: Any, now: Any, path: str) -> Any:
    """Return a value, converted to the type of a field."""
    if isinstance(kind, AbstractNestedType):
        if not isinstance(value, Sequence) or isinstance(value, str):
            raise FieldError(path, f"{value!r} is no list")
        return [_made(kind.value_type, item, now, f"{path}[{i}]") for i, item in enumerate(value)]
    if isinstance(kind, NamespacedType):
        name = "/".join(kind.namespaced_name())
        if now is not None and name == TIME_TYPE and value == "now":
            return now
        if now is not None and name == HEADER_TYPE and value == "auto":
            return interface(name)(stamp=now)
        return _filled(interface(name), value, now, f"{path}.")
    if isinstance(kind, (AbstractString, AbstractWString)):
        return str(value)
    return _number(kind, value, path)


def _number(kind: BasicType, value: Any, path: str) -> Any:
    try:
        if kind.typename == "octet":
            return value.encode("latin-1") if isinstance(value, str) else bytes([value])
        return float(value) if kind.typename in FLOATS and not isinstance(value, bool) else value
    except (TypeError, ValueError) as error:
        raise FieldError(path, error) from error


def values_of(text: str) -> Any:
    """Return the mapping that a YAML text holds. Raises FieldError if the text is no YAML or no mapping."""
    try:
        found = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise FieldError("", f"{text!r} is no YAML: {' '.join(str(error).split())}") from error
    if not isinstance(found, dict):
        raise FieldError("", "The passed value needs to be a dictionary in YAML format")
    return found
