"""Coefficients of physics as text in the form of a ROS parameter file, as `identify` writes it and the topic `physics` carries it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from enum import Enum
from typing import Any

import yaml

from .errors import BadChoice, NotFinite, TtError
from .physics import Physics

LISTENERS = ("track", "predict", "racket")  # nodes that take coefficients from the topic `physics` while they run
PHYSICS_NODES = ("estimate", *LISTENERS, "learn", "markers", "view")  # nodes that use the models; not `sim`, whose models are the truth
PHYSICS_PARTS = ("air", "table", "racket")
MOST_CHARACTERS = 20_000  # of a text; one has 6,000


class PhysicsFailure(Enum):
    """Why a text holds no coefficients for a node."""

    TOO_LONG = "text of {size} characters is longer than {most}"
    NO_YAML = "no YAML: {error}"
    NOTHING = "nothing for /**/{node}"


def physics_to_text(physics: Physics, base: str, nodes: Sequence[str] = PHYSICS_NODES) -> str:
    """Return the text of a ROS parameter file with all coefficients, for each of several nodes.

    Args:
        physics: The models of air, table and racket.
        base: Name of the models that the coefficients were derived from, "liu" or "measured": value of the parameter `physics`.
        nodes: Names of the nodes.
    """
    values = [
        f"    {part}.{field.name}: {float(getattr(getattr(physics, part), field.name))!r}"
        for part in PHYSICS_PARTS
        for field in fields(getattr(physics, part))
    ]
    lines = list[str]()
    for node in nodes:
        lines += [f"/**/{node}:", "  ros__parameters:", f"    physics: {base}", *values]
    return "\n".join(lines) + "\n"


def physics_from_text(text: str, node: str, present: Physics) -> Physics:
    """Return the models of a node with the coefficients of a text that `physics_to_text` has made.

    Args:
        text: The text. It may come from anywhere, so it is checked.
        node: Name of the node.
        present: Models whose coefficients are kept where the text does not name them.

    Raises:
        TtError: The text is too long, is no parameter file, or has nothing for this node.
        BadChoice: A coefficient is unknown.
        NotFinite: A coefficient is no finite number.
        OutOfRange: A coefficient is outside its range.
    """
    if len(text) > MOST_CHARACTERS:
        raise TtError(PhysicsFailure.TOO_LONG, size=len(text), most=MOST_CHARACTERS)
    try:
        content = yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError, ValueError, TypeError, AttributeError, LookupError) as error:
        raise TtError(PhysicsFailure.NO_YAML, error=type(error).__name__) from None
    section = _mapping(_mapping(content).get(f"/**/{node}"))
    values = _mapping(section.get("ros__parameters"))
    if not values:
        raise TtError(PhysicsFailure.NOTHING, node=node)
    changes: dict[str, dict[str, float]] = {part: {} for part in PHYSICS_PARTS}
    for name, value in values.items():
        if name == "physics":
            continue
        part, _, field = str(name).partition(".")
        known = tuple(one.name for one in fields(getattr(present, part))) if part in PHYSICS_PARTS else ()
        if field not in known:
            raise BadChoice("coefficient", str(name), tuple(f"{part}.{one}" for one in known) or PHYSICS_PARTS)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise NotFinite(str(name), value)
        changes[part][field] = float(value)
    return replace(present, **{part: replace(getattr(present, part), **changes[part]) for part in PHYSICS_PARTS})


def _mapping(value: Any) -> Mapping[Any, Any]:
    """Return a value if it is a mapping, else an empty one."""
    return value if isinstance(value, Mapping) else {}
