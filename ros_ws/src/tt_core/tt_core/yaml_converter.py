"""The cattrs converter that makes dataclasses from the content of YAML files and reports all wrong values."""

from __future__ import annotations

import math
import types
import typing
from collections.abc import Callable, Iterator, Mapping
from dataclasses import Field, fields, is_dataclass
from typing import Any

import numpy as np
from cattrs import Converter
from cattrs.cols import homogenous_tuple_structure_factory, list_structure_factory
from cattrs.errors import AttributeValidationNote, ClassValidationError, ForbiddenExtraKeysError, IterableValidationError
from cattrs.gen import make_dict_structure_fn, override

from .errors import BadChoice, NotFinite, TtError
from .flight import Aerodynamics
from .params import check_value
from .physics import Physics
from .states import BallState
from .yaml_errors import MissingKey, Problem, UnknownKey, WrongContent, WrongType

LARGEST_INT = 2**63 - 1  # the largest that every array and file format here holds

NAMED_MODELS = {
    "liu": Physics.liu(),
    "measured": Physics.measured(),
    "gravity only": Physics(air=Aerodynamics.gravity_only()),
}


def not_in_file() -> Mapping[str, bool]:
    """Return the metadata that marks a dataclass field as one that no file may set."""
    return {"not_in_file": True}


def _float(value: object, _: Any) -> float:
    number = value if isinstance(value, float) else _int(value, "of type float")
    if not math.isfinite(number):
        raise NotFinite("", number)
    return float(number)


def _int(value: object, wanted: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or abs(value) > LARGEST_INT:
        raise WrongType(value, wanted if isinstance(wanted, str) else "of type int")
    return value


def _exactly(kind: type) -> Callable[[object, Any], Any]:
    def structure(value: object, _: Any) -> Any:
        if not isinstance(value, kind):
            raise WrongType(value, f"of type {kind.__name__}")
        return value

    return structure


def _list(kind: Any, converter: Converter) -> Callable[[object, Any], Any]:
    """Take lists only; arrays become lists of numbers, which the dataclass makes arrays of."""
    is_array = typing.get_origin(kind) is np.ndarray
    each = list_structure_factory(list[float], converter) if is_array else homogenous_tuple_structure_factory(kind, converter)

    def structure(value: Any, _: Any) -> Any:
        if not isinstance(value, list):
            raise WrongType(value, "of type list")
        return each(value, list[float] if is_array else kind)

    return structure


def _one_or_several(kind: Any, converter: Converter) -> Callable[[object, Any], Any]:
    """Take one value or a list of them, of a union of a type and a tuple of it."""
    several, one = sorted(typing.get_args(kind), key=lambda part: typing.get_origin(part) is not tuple)
    return lambda value, _: converter.structure(value, several if isinstance(value, list) else one)


def _is_one_or_several(kind: Any) -> bool:
    parts = typing.get_args(kind)
    return typing.get_origin(kind) in (typing.Union, types.UnionType) and len(parts) == 2 and type(None) not in parts


def _mapping(
    kind: type, converter: Converter, *, also_known: tuple[str, ...] = (), left_out: tuple[str, ...] = ()
) -> Callable[[object, Any], Any]:
    """Make instances of a dataclass from mappings, and tell every problem at once.

    Args:
        kind: The dataclass.
        converter: For its fields.
        also_known: Other keys that a file may have, named in errors.
        left_out: Fields that no file may set, besides those marked by `not_in_file`.
    """
    unknown = {f.name: override(omit=True) for f in fields(kind) if "not_in_file" in f.metadata or f.name in left_out}
    make: Callable[[Any, Any], Any] = make_dict_structure_fn(kind, converter, **unknown)  # type: ignore[arg-type]
    params = {f.name: f for f in fields(kind) if "low" in f.metadata}  # made by tt_core.params.param
    known = (*also_known, *(f.name for f in fields(kind) if f.name not in unknown))

    def structure(value: Any, _: Any) -> Any:
        if isinstance(value, kind):
            return value
        if not isinstance(value, Mapping):
            raise WrongContent([Problem("", WrongType(value, "a mapping of keys to values"))])
        try:
            return make(value, kind)
        except ClassValidationError as error:
            problems = list(_problems(error, known))
            raise WrongContent([*problems, *_outside(value, params, {problem.path for problem in problems})]) from error

    return structure


def _problems(error: Exception, known: tuple[str, ...]) -> Iterator[Problem]:
    """Translate what cattrs raises."""
    if isinstance(error, WrongContent):
        yield from error.problems
    elif isinstance(error, ForbiddenExtraKeysError):
        yield from (Problem(str(key), UnknownKey(key, known)) for key in sorted(error.extra_fields, key=str))
    elif isinstance(error, (ClassValidationError, IterableValidationError)):
        noted, plain = error.group_exceptions()
        for cause, note in noted:
            place = note.name if isinstance(note, AttributeValidationNote) else f"[{note.index}]"
            if isinstance(cause, KeyError):  # cattrs looks it up in the mapping
                yield Problem(place, MissingKey(place))
            else:
                yield from (Problem(_joined(place, problem.path), problem.cause) for problem in _problems(cause, known))
        for cause in plain:
            yield from _problems(cause, known)
    elif isinstance(error, TtError):
        yield Problem(getattr(error, "name", ""), error)
    else:
        raise error


def _joined(place: str, path: str) -> str:
    return f"{place}.{path}" if path and not path.startswith("[") else place + path


def _outside(content: Mapping[str, Any], params: dict[str, Field[Any]], reported: set[str]) -> Iterator[Problem]:
    """Find the values outside the ranges of their fields that are not told yet: a dataclass stops at its first one."""
    for name in [name for name in params if name in content and name not in reported]:
        try:
            check_value(name, content[name], params[name].default, params[name].metadata)
        except TtError as error:
            yield Problem(error.name, error)  # type: ignore[attr-defined]
        except (TypeError, ValueError, OverflowError):  # of another type, which is told
            continue


def _physics(value: Any, _: Any) -> Physics:
    """Take the name of one of NAMED_MODELS, or a mapping: the name as `model`, and single coefficients that replace those of the model."""
    if isinstance(value, Physics):
        return value
    content = {"model": value} if isinstance(value, str) else value
    if not isinstance(content, Mapping):
        raise WrongType(value, "a name or a mapping of keys to values")
    name = content.get("model", "liu")
    if not isinstance(name, str):
        raise WrongContent([Problem("model", WrongType(name, "of type str"))])
    if name not in NAMED_MODELS:
        raise WrongContent([Problem("model", BadChoice("model", name, tuple(NAMED_MODELS)))])
    defaults = {f.name: getattr(NAMED_MODELS[name], f.name) for f in fields(Physics)}
    given = {key: _completed(part, defaults.get(key)) for key, part in content.items() if key != "model"}
    return typing.cast(Physics, _PHYSICS(defaults | given, Physics))


def _completed(content: Any, default: Any) -> Any:
    """Return a mapping with the values of a default instance where it has none; anything else as it is."""
    if not is_dataclass(default) or not isinstance(content, Mapping):
        return content
    return {f.name: getattr(default, f.name) for f in fields(default)} | dict(content)


def _ball(value: Any, kind: Any) -> BallState:
    """Take a ball without a time, which is 0 then."""
    return typing.cast(BallState, _BALL({"time": 0.0, **value} if isinstance(value, Mapping) else value, kind))


def _converter() -> Converter:
    converter = Converter(forbid_extra_keys=True)
    converter.register_structure_hook_factory(is_dataclass, _mapping)
    converter.register_structure_hook_factory(lambda kind: typing.get_origin(kind) in (tuple, np.ndarray), _list)
    converter.register_structure_hook_factory(_is_one_or_several, _one_or_several)
    converter.register_structure_hook(float, _float)
    converter.register_structure_hook(int, _int)
    converter.register_structure_hook(str, _exactly(str))
    converter.register_structure_hook(bool, _exactly(bool))
    converter.register_structure_hook(Physics, _physics)
    converter.register_structure_hook(BallState, _ball)
    return converter


CONVERTER = _converter()
_PHYSICS = _mapping(Physics, CONVERTER, also_known=("model",))
_BALL = _mapping(BallState, CONVERTER, left_out=("covariance",))
