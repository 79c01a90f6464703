"""Reading of dataclasses from YAML files, with strict checks, by cattrs.

Unknown and repeated keys are refused. An error names the file and the path of every wrong value.
For example: `fast.yaml: launcher.rate: -3 is outside [26, 94]`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from .yaml_converter import CONVERTER, not_in_file
from .yaml_errors import BadFile, MissingKey, Problem, UnknownKey, Unreadable, WrongContent, WrongType, shown_value

__all__ = [
    "BadFile",
    "MissingKey",
    "Problem",
    "UnknownKey",
    "Unreadable",
    "WrongType",
    "build",
    "find_file",
    "not_in_file",
    "read_yaml",
    "yaml_names",
]

MOST_YAML_BYTES = 100_000  # of a file; those of this workspace have 3,000 at most, and the parser takes 1 s for 200,000
MOST_KEYS = 1000  # of one mapping, so that merges of merges (<<) end


def yaml_names(folder: Path) -> list[str]:
    """Return the names of the YAML files in `folder`, without suffix."""
    return sorted(file.stem for file in folder.glob("*.yaml"))


def find_file(name: str, folder: Path, beside: Path = Path()) -> Path:
    """Return the path of a file that is given by its name or its path.

    Args:
        name: Name of a YAML file in `folder`, without suffix, or the path of a file. A name is tried first.
        folder: Folder of the files that have names.
        beside: Folder to which a path may be relative, if the working directory has no such file.

    Raises:
        BadFile: There is no such file.
    """
    if name in yaml_names(folder):
        return folder / f"{name}.yaml"
    for path in (Path(name), beside / name):
        if path.suffix == ".yaml" and path.is_file():
            return path
    known = f"no such file, and none of the {folder.name} here, {', '.join(yaml_names(folder))}"
    raise BadFile(name, (Problem("", Unreadable(known)),))


class _StrictLoader(yaml.SafeLoader):
    """Refuse a key that is given twice, of which YAML's readers take the last, and mappings that grow by merging without end."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode) and key.tag != "tag:yaml.org,2002:merge":
                value = self.construct_object(key)
                if value in seen:
                    raise yaml.constructor.ConstructorError(None, None, f"{shown_value(value)} is given twice", key.start_mark)
                seen.add(value)
        return super().construct_mapping(node, deep)

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        super().flatten_mapping(node)
        if len(node.value) > MOST_KEYS:
            raise yaml.constructor.ConstructorError(None, None, f"more than {MOST_KEYS} keys", node.start_mark)


def read_yaml(file: Path) -> dict[str, Any]:
    """Read a YAML file that holds a mapping.

    Raises:
        BadFile: The file cannot be read, is longer than MOST_YAML_BYTES, or holds no mapping.
    """
    try:
        if file.stat().st_size > MOST_YAML_BYTES:
            raise BadFile(file.name, (Problem("", Unreadable(f"longer than {MOST_YAML_BYTES} bytes")),))
        content = yaml.load(file.read_text(encoding="utf-8"), _StrictLoader)
    # PyYAML lets the errors of int(), float() and date() pass for malformed scalars, and RecursionError for deep nesting
    except (OSError, yaml.YAMLError, RecursionError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        if isinstance(error, BadFile):
            raise
        raise BadFile(file.name, (Problem("", Unreadable(" ".join(str(error).split()))),)) from error
    if not isinstance(content, dict):
        raise BadFile(file.name, (Problem("", WrongType(content, "a mapping of keys to values")),))
    return content


def build(kind: type, content: Mapping[str, Any], file: str) -> Any:
    """Make an instance of a dataclass from a mapping.

    Fields that are missing in the mapping have their defaults. Values that are instances already are taken as they are. Fields marked by
    `not_in_file` are refused as unknown keys.

    Args:
        kind: The dataclass.
        content: The mapping, as `read_yaml` returns it.
        file: Name of the file, for errors.

    Raises:
        BadFile: A value is wrong, a key is unknown, or a field without a default is missing.
    """
    try:
        return CONVERTER.structure(content, kind)
    except WrongContent as wrong:
        raise BadFile(file, tuple(wrong.problems)) from wrong
