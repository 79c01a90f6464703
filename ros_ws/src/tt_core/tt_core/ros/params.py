"""ROS parameters from a dataclass, declared once for every node."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, TypeVar, overload

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node

from ..errors import TtError
from ..physics import Physics

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


@overload
def declare(node: Node, kind: type[T], prefix: str = "") -> T: ...
@overload
def declare(node: Node, kind: T, prefix: str = "") -> T: ...
def declare(node: Node, kind: Any, prefix: str = "") -> Any:
    """Declare every field of a dataclass, with the defaults of `kind` (a class or an instance), and return an instance of the values set.

    The dataclass's own checks apply.
    """
    default = kind() if isinstance(kind, type) else kind
    values = {f.name: parameter(node, prefix + f.name, getattr(default, f.name)) for f in fields(default)}
    return type(default)(**values)


def declare_physics(node: Node, prefix: str = "") -> Physics:
    """`physics` names the models, "liu" or "measured"; air.*, table.* and racket.* override single coefficients."""
    name = parameter(node, prefix + "physics", "liu")
    if name not in ("liu", "measured"):
        raise TtError(f"parameter {prefix}physics = {name!r} is none of 'liu', 'measured'")
    default = Physics.liu() if name == "liu" else Physics.measured()
    return Physics(
        declare(node, default.air, prefix + "air."),
        declare(node, default.table, prefix + "table."),
        declare(node, default.racket, prefix + "racket."),
        parameter(node, prefix + "contact_height", default.contact_height),
    )
