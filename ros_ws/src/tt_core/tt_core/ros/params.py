"""ROS parameters from dataclasses: declared with description and range, and read-only unless they act while the node runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any, TypeVar, overload
from weakref import WeakKeyDictionary

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from ..constants import BALL_RADIUS
from ..errors import TtError
from ..params import check_value, coerce, param
from ..physics import Physics

T = TypeVar("T")
_CHANGED: WeakKeyDictionary[Node, dict[str, Any]] = WeakKeyDictionary()  # values that are not the defaults, by name


@overload
def declare(node: Node, kind: type[T], prefix: str = "", changed: Callable[[T], None] | None = None) -> T: ...
@overload
def declare(node: Node, kind: T, prefix: str = "", changed: Callable[[T], None] | None = None) -> T: ...
def declare(node: Node, kind: Any, prefix: str = "", changed: Callable[[Any], None] | None = None) -> Any:
    """Declare every field of a dataclass as a ROS parameter, and return an instance with the values that were set.

    Args:
        node: The node that has the parameters.
        kind: A dataclass of `tt_core.params.param` fields, or an instance of one that has the defaults.
        prefix: Put before each name, e.g. "swing.".
        changed: Called with a new instance after parameters that are marked dynamic were set. Without it all parameters are read-only.

    Raises:
        TtError: A value has the wrong type or is outside its range; the message names parameter, value and range.
    """
    default = kind() if isinstance(kind, type) else kind
    values, dynamic = {}, set[str]()
    for f in fields(default):
        settable = changed is not None and f.metadata["dynamic"]
        values[f.name] = _declare(node, prefix + f.name, getattr(default, f.name), f.default, f.metadata, read_only=not settable)
        if settable:
            dynamic.add(f.name)
    differing = {prefix + name: value for name, value in values.items() if value != getattr(default, name)}
    _CHANGED.setdefault(node, {}).update(differing)
    params = type(default)(**values)
    if changed is not None:
        _Follower(node, prefix, params, frozenset(dynamic), changed)
    return params


def changed_parameters(node: Node) -> dict[str, Any]:
    """Return the parameters of a node whose values at their declaration were not the defaults, by name."""
    return dict(_CHANGED.get(node, {}))


def _declare(node: Node, name: str, value: Any, standard: Any, metadata: Mapping[str, Any], *, read_only: bool) -> Any:
    """Declare one parameter and return its value; `value` is used if none is set, or if NaN is set."""
    # the first declaration takes whatever type was given, so that 1 can stand for 1.0 and an error can be ours
    probe = ParameterDescriptor(dynamic_typing=True)
    given = node.declare_parameter(name, list(value) if isinstance(value, tuple) else value, probe).value
    node.undeclare_parameter(name)
    if given is None and isinstance(value, tuple):  # so comes an empty list
        given = ()
    used = value if isinstance(given, float) and math.isnan(given) else coerce(name, given, value)
    check_value(name, used, standard, metadata)
    listed = list(used) if isinstance(used, tuple) else used
    descriptor = parameter_descriptor(metadata, value, read_only=read_only)
    descriptor.dynamic_typing = listed == []  # an empty list has no type
    node.declare_parameter(name, listed, descriptor, ignore_override=True)
    return used


def parameter_descriptor(metadata: Mapping[str, Any], default: Any, *, read_only: bool) -> ParameterDescriptor:
    """Return the descriptor of a parameter, which `ros2 param describe` shows.

    Args:
        metadata: Metadata of a field made by `tt_core.params.param`.
        default: Default of the field, which gives the type of the range.
        read_only: Whether the parameter cannot be set after the start.
    """
    unit, low, high, choices = (metadata[key] for key in ("unit", "low", "high", "choices"))
    descriptor = ParameterDescriptor(description=metadata["meaning"] + (f" ({unit})" if unit else ""), read_only=read_only)
    bounded = math.isfinite(low) and math.isfinite(high)
    if choices:
        descriptor.additional_constraints = f"one of {', '.join(map(repr, choices))}"
    elif bounded and isinstance(default, float):
        descriptor.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high))]
    elif bounded and isinstance(default, int) and not isinstance(default, bool):
        descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
    elif math.isfinite(low) or math.isfinite(high):
        descriptor.additional_constraints = f"within [{low:g}, {high:g}]" + (", each element" if isinstance(default, tuple) else "")
    return descriptor


class _Follower:
    """Keeps the instance that belongs to the parameters of one prefix, and calls a function when it has changed."""

    def __init__(self, node: Node, prefix: str, params: Any, dynamic: frozenset[str], changed: Callable[[Any], None]) -> None:
        self._prefix, self._params, self._dynamic, self._changed = prefix, params, dynamic, changed
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply)

    def _updated(self, parameters: list[Parameter]) -> Any:
        names = {p.name: p.name.removeprefix(self._prefix) for p in parameters if p.name.startswith(self._prefix)}
        new = {names[p.name]: p.value for p in parameters if names.get(p.name) in self._dynamic}
        values = {name: tuple(value) if isinstance(getattr(self._params, name), tuple) else value for name, value in new.items()}
        return replace(self._params, **values) if values else None

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            self._updated(parameters)
        except (TtError, TypeError) as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply(self, parameters: list[Parameter]) -> None:
        params = self._updated(parameters)
        if params is not None:
            self._params = params
            self._changed(params)


@dataclass(frozen=True)
class PhysicsParams:
    """Parameters that choose the models of air, table and rubber."""

    physics: str = param("liu", "", "models of flight and rebounds: of the dissertation, or of real balls", choices=("liu", "measured"))
    contact_height: float = param(BALL_RADIUS, "m", "from a surface to the centre of a ball that touches it", low=0.0, high=0.1)


def declare_physics(node: Node, prefix: str = "") -> Physics:
    """Declare the parameters of the models of air, table and rubber, and return the models.

    The parameters are `physics`, the name of the models, then `contact_height` and the coefficients air.*, table.* and racket.*. A
    coefficient that is set replaces that of the named models; NaN keeps it.

    Args:
        node: The node that has the parameters.
        prefix: Put before each name.

    Raises:
        TtError: A value has the wrong type or is outside its range.
    """
    return read_physics(partial(declare, node), prefix)


def read_physics(read: Callable[..., Any], prefix: str = "") -> Physics:
    """Return the models of air, table and rubber that parameters give.

    Args:
        read: Function that takes a dataclass of parameters, or an instance that has the defaults, and a prefix, and returns an instance
            with the values that were set.
        prefix: Put before each name.
    """
    params = read(PhysicsParams, prefix)
    default = Physics.liu() if params.physics == "liu" else Physics.measured()
    return Physics(
        read(default.air, prefix + "air."),
        read(default.table, prefix + "table."),
        read(default.racket, prefix + "racket."),
        params.contact_height,
    )
