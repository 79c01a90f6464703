"""Compare two recordings topic by topic: how many messages differ, and by how much, with units.

Messages are paired by their stamps, and by their order where they have none. The exit code is 0 if all are equal, 1 if not.
"""

from __future__ import annotations

import argparse
import itertools
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from tt_core.errors import TtError
from tt_core.ros.bags import Bag, Message

QUANTITIES = (  # regular expression that the path of a field matches, physical quantity, unit
    (r"covariance", "covariance", ""),
    (r"(pose\.position|translation|point)$", "position", "m"),
    (r"(twist\.linear|velocities\[\]\.linear)$", "velocity", "m/s"),
    (r"(twist\.angular|velocities\[\]\.angular)$", "angular velocity", "rad/s"),
    (r"(orientation|rotation)$", "rotation, quaternion", ""),
    (r"time_from_start$", "time from start", "s"),
    (r"stamp$", "stamp", "s"),
    (r"positions?$", "joint position", "rad"),
    (r"velocit(y|ies)$", "joint speed", "rad/s"),
    (r"effort$", "torque", "N m"),
)
BY_KIND = {("sensor_msgs/msg/Image", "data"): ("brightness", "grey levels"), ("std_msgs/msg/Float64MultiArray", "data"): ("value", "rad/s")}


@dataclass
class Difference:
    """Differences between two recordings of one topic.

    Attributes:
        topic: Name of the topic.
        counts: Number of messages in each of the two recordings.
        paired: Number of messages that are in both recordings.
        unequal: Number of these pairs whose messages differ.
        largest: Largest difference of each physical quantity, by its name and unit.
        other: Fields that differ and are not numbers, or whose lengths differ.
    """

    topic: str
    counts: tuple[int, int]
    paired: int = 0
    unequal: int = 0
    largest: dict[tuple[str, str], float] = field(default_factory=dict)
    other: set[str] = field(default_factory=set)

    @property
    def is_equal(self) -> bool:
        """Whether both recordings have the same messages on this topic."""
        return self.counts == (self.paired, self.paired) and not self.unequal

    def words(self) -> str:
        """Return the differences as text for people; "" if there are none."""
        parts = [f"{name} {value:.3g} {unit}".rstrip() for (name, unit), value in sorted(self.largest.items())]
        return ", ".join([*parts, *(f"{name} differs" for name in sorted(self.other))])


def values(message: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield path and value of each field of a message. A vector x, y, z, a quaternion and a time (s) are one value each.

    Args:
        message: A message, or a part of one.
        path: Path of this part, e.g. "pose.pose"; "" for a whole message. In paths, [] is the first element of a list, [1] the second.
    """
    names = [name for name in getattr(message, "__dataclass_fields__", ()) if name != "__msgtype__"]
    if names in (["x", "y", "z"], ["x", "y", "z", "w"]):
        yield path, np.array([getattr(message, name) for name in names])
    elif names == ["sec", "nanosec"]:
        yield path, np.array([message.sec + message.nanosec * 1e-9])
    elif names:
        for name in names:
            yield from values(getattr(message, name), f"{path}.{name}".lstrip("."))
    elif isinstance(message, list) and message and hasattr(message[0], "__dataclass_fields__"):
        for i, item in enumerate(message):
            yield from ((name.replace("[]", f"[{i}]", 1) if i else name, value) for name, value in values(item, f"{path}[]"))
    else:
        yield path, message


def compare(a: Path, b: Path) -> list[Difference]:
    """Compare two recordings.

    Args:
        a: The first recording, a bag of any kind.
        b: The second recording, a bag of any kind.

    Returns:
        The differences of each topic that one of the recordings has, sorted by topic.

    Raises:
        BagError: A recording cannot be read.
    """
    with Bag(a) as first, Bag(b) as second:
        found = []
        for topic in sorted({topic.name for bag in (first, second) for topic in bag.topics}):
            found.append(_topic(topic, first, second))
        return found


def _topic(topic: str, first: Bag, second: Bag) -> Difference:
    left, right = (_keyed(bag, topic) for bag in (first, second))
    difference = Difference(topic, (len(left), len(right)))
    for key in left.keys() & right.keys():
        difference.paired += 1
        if left[key].data == right[key].data:
            continue
        if _add(difference, left[key].kind, first.decode(left[key]), second.decode(right[key])):
            difference.unequal += 1
    return difference


def _keyed(bag: Bag, topic: str) -> dict[tuple[int, int], Message]:
    """Return the messages by stamp (ns; without a header by their number) and by how many messages of that stamp came before."""
    found: dict[tuple[int, int], Message] = {}
    seen: dict[int, itertools.count[int]] = {}
    if topic not in {one.name for one in bag.topics if not one.refusal}:
        return found
    for i, message in enumerate(bag.messages([topic])):
        header = getattr(bag.decode(message), "header", None)
        stamp = header.stamp.sec * 10**9 + header.stamp.nanosec if header is not None else i
        found[stamp, next(seen.setdefault(stamp, itertools.count()))] = message
    return found


def _add(difference: Difference, kind: str, left: Any, right: Any) -> bool:
    """Add the differences of two messages. Return whether there are any; different padding bytes do not count."""
    one, other, differs = dict(values(left)), dict(values(right)), False
    for path in one.keys() | other.keys():
        if path not in one or path not in other:
            differs = True
            difference.other.add(f"number of {path.partition('[')[0]}")
            continue
        x, y = one[path], other[path]
        name, unit = quantity(kind, path)
        if isinstance(x, (np.ndarray, int, float)) and isinstance(y, (np.ndarray, int, float)) and np.shape(x) == np.shape(y):
            gap = np.ravel(np.subtract(x, y, dtype=float))
            size = float(np.linalg.norm(gap) if len(gap) == 3 else np.abs(gap).max(initial=0.0))  # length of a vector
            if size:
                differs = True
                difference.largest[name, unit] = max(size, difference.largest.get((name, unit), 0.0))
        elif not np.array_equal(x, y) if isinstance(x, np.ndarray) or isinstance(y, np.ndarray) else x != y:
            differs = True
            difference.other.add(re.sub(r"\[\d+\]", "[]", path))
    return differs


def quantity(kind: str, path: str) -> tuple[str, str]:
    """Return the physical quantity that a field of a message holds, and its unit; the path and "" if it is not known.

    Args:
        kind: Message type, e.g. "sensor_msgs/msg/Image".
        path: Path of the field, as `values` yields it.
    """
    plain = re.sub(r"\[\d+\]", "[]", path)
    if (kind, plain) in BY_KIND:
        return BY_KIND[kind, plain]
    return next(((name, unit) for pattern, name, unit in QUANTITIES if re.search(pattern, plain)), (plain, ""))


def main() -> int:
    """Run the command `ros2 run tt_bringup compare` and return its exit code: 0 equal, 1 different, 2 not readable."""
    parser = argparse.ArgumentParser(prog="compare", description=__doc__)
    parser.add_argument("a", type=Path, help="recording of any kind")
    parser.add_argument("b", type=Path, help="recording of any kind")
    args = parser.parse_args()
    try:
        found = compare(args.a, args.b)
    except TtError as error:
        print(f"compare: {error}", file=sys.stderr)
        return 2
    table = Table("topic", "in A", "in B", "in both", "differ", "largest difference", box=None)
    for one in found:
        table.add_row(one.topic, *map(str, (*one.counts, one.paired, one.unequal)), one.words())
    Console(width=None if sys.stdout.isatty() else 160).print(table)
    equal = all(one.is_equal for one in found)
    print("the recordings are equal" if equal else "the recordings differ")
    return 0 if equal else 1
