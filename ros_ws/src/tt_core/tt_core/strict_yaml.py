"""Dataclasses from YAML files, strictly: nothing is taken that is not known, and an error names the file and the path in it.

For example: `fast.yaml: launcher.rate: -3 is outside [26, 94]`.
"""

from __future__ import annotations

import functools
import types
import typing
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from .bounce import RacketRebound, TableRebound
from .constants import BALL_RADIUS
from .errors import OutOfRange, TtError
from .flight import Aerodynamics
from .physics import Physics
from .states import BallState

MODELS = {
    "liu": Physics.liu(),
    "measured": Physics.measured(),
    "gravity only": Physics(air=Aerodynamics.gravity_only()),
}


class BadFile(TtError):
    """A file that cannot be used: its name, the path in it, and why."""


def one_of(name: str, value: str, known: tuple[str, ...]) -> None:
    """Check that a text is one of those known; raises TtError."""
    if value not in known:
        raise TtError(f"{name} {value!r} is none of {', '.join(known)}")


def names(folder: Path) -> list[str]:
    """Return the names of the YAML files in `folder`, without the ending, sorted."""
    return sorted(file.stem for file in folder.glob("*.yaml"))


def find(name: str, folder: Path, beside: Path = Path()) -> Path:
    """Find a YAML file.

    Args:
        name: Name of a file in `folder` without the ending, or a path.
        folder: Where files are found by name.
        beside: What a path may be relative to.

    Raises:
        BadFile: There is no such file.
    """
    if name in names(folder):
        return folder / f"{name}.yaml"
    for path in (Path(name), beside / name):
        if path.suffix == ".yaml" and path.is_file():
            return path
    raise BadFile(f"{name}: no such file, and none of the {folder.name} here, {', '.join(names(folder))}")


class _Strict(yaml.SafeLoader):
    """Refuses a key that is given twice, where other readers of YAML take the last value."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [key.value for key, _ in node.value]
        twice = next((key for key in keys if keys.count(key) > 1), None)
        if twice is not None:
            raise yaml.constructor.ConstructorError(None, None, f"{twice} is given twice", node.start_mark)
        return super().construct_mapping(node, deep)


def read(file: Path) -> dict[str, Any]:
    """Return the mapping that a YAML file holds; raises BadFile."""
    try:
        content = yaml.load(file.read_text(), _Strict)
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise BadFile(f"{file.name}: {' '.join(str(error).split())}") from error
    if not isinstance(content, dict):
        raise BadFile(f"{file.name}: {content!r} is not a mapping of keys to values")
    return content


@functools.cache
def _hints(kind: type) -> dict[str, Any]:
    return typing.get_type_hints(kind)


def build(kind: Any, content: Any, file: str, path: str = "", default: Any = None) -> Any:
    """Build a dataclass from a mapping, strictly.

    Args:
        kind: The dataclass.
        content: The mapping, as read.
        file: Name of the file, for errors.
        path: Keys above this mapping in the file, joined by dots, for errors.
        default: Instance whose values fields have that are not in the mapping; None for the defaults of the class.

    Raises:
        BadFile: A key is unknown, a value has the wrong type or is out of range, or a field without default is missing.
    """

    def refuse(key: str, why: str) -> BadFile:
        where = ".".join(part for part in (path, key) if part)
        return BadFile(f"{file}: {where}: {why}" if where else f"{file}: {why}")

    if not isinstance(content, Mapping):
        raise refuse("", f"{content!r} is not a mapping of keys to values")
    known = [f.name for f in fields(kind) if f.init and f.name not in ("name", "covariance")]
    values = {name: getattr(default, name) for name in known} if default is not None else {}
    if kind is BallState:
        values["time"] = 0.0
    for key, value in content.items():
        if key not in known:
            raise refuse(str(key), f"unknown, known are {', '.join(known)}")
        below = ".".join(part for part in (path, key) if part)
        values[key] = _value(_hints(kind)[key], value, file, below)
    try:
        return kind(**values)
    except OutOfRange as error:
        raise refuse(error.name, f"{error.value:g} is outside [{error.low:g}, {error.high:g}]") from error
    except (TtError, TypeError) as error:
        raise refuse("", str(error)) from error


def _value(hint: Any, value: Any, file: str, path: str) -> Any:
    """Return `value` in the type of a field; raises BadFile."""
    if is_dataclass(value):
        return value
    if hint is Physics:
        return _physics(value, file, path)
    options = [part for part in typing.get_args(hint) if part is not type(None)] if _is_union(hint) else [hint]
    for option in options:
        if is_dataclass(option):
            return build(option, value, file, path)
        if option in (str, bool) and isinstance(value, option):
            return value
        if option is float and isinstance(value, int | float) and not isinstance(value, bool):
            return float(value)
        if option is int and isinstance(value, int) and not isinstance(value, bool):
            return value
        if typing.get_origin(option) in (tuple, list) and isinstance(value, list):
            part = typing.get_args(option)[0]
            return tuple(_value(part, one, file, f"{path}[{i}]") for i, one in enumerate(value))
        if "ndarray" in str(option) and isinstance(value, list):
            return [_value(float, one, file, f"{path}[{i}]") for i, one in enumerate(value)]
    wanted = " or ".join(getattr(option, "__name__", str(option)) if typing.get_origin(option) is None else "list" for option in options)
    raise BadFile(f"{file}: {path}: {value!r} is not of type {wanted}")


def _is_union(hint: Any) -> bool:
    return typing.get_origin(hint) in (typing.Union, types.UnionType)


def _physics(content: Any, file: str, path: str) -> Physics:
    """Return the models for a name of MODELS, or for a mapping with the name as `model` and single coefficients of air, table, racket."""
    content = {"model": content} if isinstance(content, str) else content
    if not isinstance(content, Mapping):
        raise BadFile(f"{file}: {path}: {content!r} is not a name or a mapping of keys to values")
    parts = {"air": Aerodynamics, "table": TableRebound, "racket": RacketRebound}
    unknown = set(content) - {"model", "contact_height", *parts}
    if unknown:
        raise BadFile(f"{file}: {path}.{sorted(map(str, unknown))[0]}: unknown, known are model, contact_height, {', '.join(parts)}")
    model = content.get("model", "liu")
    if model not in MODELS:
        raise BadFile(f"{file}: {path}.model: {model!r} is none of {', '.join(MODELS)}")
    default = MODELS[model]
    given = {
        name: build(kind, content[name], file, f"{path}.{name}", getattr(default, name)) for name, kind in parts.items() if name in content
    }
    height = _value(float, content.get("contact_height", BALL_RADIUS), file, f"{path}.contact_height")
    try:
        return replace(default, contact_height=height, **given)
    except OutOfRange as error:
        raise BadFile(f"{file}: {path}.{error.name}: {error.value:g} is outside [{error.low:g}, {error.high:g}]") from error
