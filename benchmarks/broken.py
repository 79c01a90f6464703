"""Messages that break their promise, made from good ones by their types alone. Used by other benchmarks."""

from __future__ import annotations

import array
import copy
import random
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message

MANY = 100_000  # entries of an oversize sequence
MANY_BYTES = 50_000_000  # of an oversize image

Make = Callable[[Any, float], Any]  # (good message, now s) -> a broken message, or the bytes of one


def parts(message: Any) -> Iterator[tuple[Any, str, str, Any]]:
    """(owner, name, type, value) of each field that is no message, of the message and of all messages in it."""
    for name, kind in message.get_fields_and_field_types().items():
        value = getattr(message, name)
        if hasattr(value, "get_fields_and_field_types"):
            if not isinstance(value, Time):
                yield from parts(value)
        elif isinstance(value, list) and value and hasattr(value[0], "get_fields_and_field_types"):
            yield message, name, kind, value
            for each in value:
                yield from parts(each)
        else:
            yield message, name, kind, value


def is_float(kind: str) -> bool:
    return "double" in kind or "float" in kind


def with_floats(value: float) -> Make:
    """Every floating-point number is `value`."""

    def make(message: Any, now: float) -> Any:
        for owner, name, kind, old in parts(message):
            if is_float(kind):
                setattr(
                    owner,
                    name,
                    value
                    if isinstance(old, float)
                    else type(old)("d", [value] * len(old))
                    if isinstance(old, array.array)
                    else np.full(len(old), value),
                )
        return message

    return make


def largest(message: Any, now: float) -> Any:
    """Every whole number is the largest of its type."""
    most = {"int8": 2**7 - 1, "uint8": 2**8 - 1, "int16": 2**15 - 1, "uint16": 2**16 - 1, "int32": 2**31 - 1, "uint32": 2**32 - 1}
    for owner, name, kind, _ in parts(message):
        if kind in most:
            setattr(owner, name, most[kind])
    return message


def empty(message: Any, now: float) -> Any:
    return type(message)()


def sequences(message: Any) -> list[tuple[str, Any]]:
    """(name, value) of the sequences that have entries, of the message itself."""
    kinds = message.get_fields_and_field_types()
    return [(name, value) for name in kinds if kinds[name].startswith("sequence") and len(value := getattr(message, name))]


def oversize(message: Any, now: float) -> Any:
    for name, value in sequences(message):
        many = MANY_BYTES if isinstance(value, array.array) and value.typecode == "B" else MANY
        setattr(message, name, (value * (1 + many // len(value)))[:many])
    return serialize_message(message)


def shorter(message: Any, now: float) -> Any:
    for name, value in sequences(message):
        setattr(message, name, value[:-1])
    return message


def longer(message: Any, now: float) -> Any:
    for name, value in sequences(message):
        setattr(message, name, value + value[-1:])
    return message


def reordered(message: Any, now: float) -> Any:
    """Names and numbers both: nothing is wrong."""
    for name, value in sequences(message):
        setattr(message, name, value[::-1])
    return message


def renamed(message: Any, now: float) -> Any:
    """Names alone."""
    for name, value in sequences(message):
        if isinstance(value[0], str):
            setattr(message, name, value[::-1])
    return message


def cut(message: Any, now: float) -> Any:
    """Half of the bytes of a message."""
    data = serialize_message(message)
    return data[: len(data) // 2]


def stamp_of(message: Any) -> Time | None:
    return message.header.stamp if hasattr(message, "header") else getattr(message, "clock", None)


def stamped(at: Callable[[float], float]) -> Make:
    """at: s, now -> s, stamp."""

    def make(message: Any, now: float) -> Any:
        stamp = stamp_of(message)
        assert stamp is not None
        stamp.sec, stamp.nanosec = divmod(round(at(now) * 1e9), 10**9)
        return message

    return make


def standing() -> Make:
    """The first stamp for ever."""
    first: list[tuple[int, int]] = []

    def make(message: Any, now: float) -> Any:
        stamp = stamp_of(message)
        assert stamp is not None
        first.append((stamp.sec, stamp.nanosec))
        del first[1:]
        stamp.sec, stamp.nanosec = first[0]
        return message

    return make


def kinds(message: Any) -> dict[str, Make]:
    """What can be wrong with a message of this type, by name."""
    found: dict[str, Make] = {"empty": empty, "cut bytes": cut}
    fields = list(parts(message))
    if any(is_float(kind) and (isinstance(value, float) or len(value)) for _, _, kind, value in fields):
        found |= {"NaN": with_floats(np.nan), "infinity": with_floats(np.inf), "1e17": with_floats(1e17)}
    if hasattr(message, "width"):
        found |= {"largest integers": largest}
    if sequences(message):
        found |= {"oversize": oversize, "too short": shorter, "too long": longer}
    if any(isinstance(value[0], str) and len(value) > 1 for _, value in sequences(message)):
        found |= {"names and values reversed": reordered, "names reversed": renamed}
    if stamp_of(message) is not None:
        found |= {
            "stamps zero": stamped(lambda now: 0.0),
            "stamps negative": stamped(lambda now: -5.0),
            "stamps standing": standing(),
            "stamps ahead 10 s": stamped(lambda now: now + 10.0),
            "stamps behind 10 s": stamped(lambda now: now - 10.0),
            "stamps jumping": stamped(lambda now: now + random.uniform(-5.0, 5.0)),
        }
    return found


def broken(make: Make, message: Any, now: float) -> Any:
    """What `make` makes of a copy."""
    return make(copy.deepcopy(message), now)
