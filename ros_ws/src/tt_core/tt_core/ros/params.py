"""ROS parameters from a dataclass, declared once for every node."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, TypeVar

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node

from ..errors import TtError

T = TypeVar("T")


def parameter(node: Node, name: str, default: Any) -> Any:
    """Declare one parameter and return its value in the type of `default`; a list takes numbers. Raises TtError for another type."""
    value = node.declare_parameter(name, default, ParameterDescriptor(dynamic_typing=True)).value
    kind = type(default)
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if kind in (list, tuple) and hasattr(value, "__len__") and not isinstance(value, (str, bytes)):
        return kind(type(default[0])(v) for v in value) if default else kind(value)
    if not isinstance(value, kind):
        raise TtError(f"parameter {name} = {value!r} is not of type {kind.__name__}")
    return value


def declare(node: Node, kind: type[T], prefix: str = "") -> T:
    """Declare every field of the dataclass `kind` with its default and return an instance of the values set; its own checks apply."""
    return kind(**{f.name: parameter(node, prefix + f.name, f.default) for f in fields(kind)})  # type: ignore[arg-type]
