"""Text of the definition of a message, service or action type, with the definitions of the types that it is made of."""

from __future__ import annotations

import re
from collections.abc import Iterator

from . import packages

SEPARATOR = "---"
FIELD = re.compile(r"\s*(?P<type>[A-Za-z]\w*(?:/\w+)*)(?:<=\d+)?(?:\[[^\]]*\])?\s+\w+\s*(?:$|[^=\s])")  # not NAME=VALUE, a constant
INTEGERS = {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)}
BASIC = INTEGERS | {"bool", "byte", "char", "float32", "float64", "string", "wstring"}


def definition(name: str, *, comments: bool = True, nested_comments: bool = False, indent: int = 0) -> Iterator[str]:
    """Yield the lines of the definition of a type. A field of a message type is followed by the lines of that type, indented by a tab.

    Args:
        name: Full name of the type, e.g. "nav_msgs/msg/Odometry".
        comments: Whether comments and empty lines are included.
        nested_comments: Whether those of nested types are included.
        indent: Number of tabs before each line.

    Raises:
        NotFound: There is no such type.
    """
    package = name.partition("/")[0]
    for line in packages.interface_file(name).read_text().splitlines():
        text = line.rstrip()
        if not comments:
            text = re.sub(r"""\s*#[^'"]*$""", "", text).strip()
        if text or comments:
            yield "\t" * indent + text if text else ""
        nested = nested_type(text, package)
        if nested:
            yield from definition(nested, comments=nested_comments, nested_comments=nested_comments, indent=indent + 1)


def nested_type(line: str, package: str) -> str | None:
    """Return the full name of the message type that a field has.

    Args:
        line: A line of a definition, e.g. "Header header".
        package: Package of the definition, to which a type without a package belongs.

    Returns:
        The full name, e.g. "std_msgs/msg/Header"; None if the field has a basic type, or the line declares no field.
    """
    match = FIELD.match(line.partition("#")[0].rstrip())
    if not match or match["type"] in BASIC:
        return None
    parts = match["type"].split("/")
    return f"{parts[0] if len(parts) > 1 else package}/msg/{parts[-1]}"
