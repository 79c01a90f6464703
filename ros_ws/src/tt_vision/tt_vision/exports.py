"""Lazy imports: a name that a package exports is imported when it is first used, so that a program loads no more than it needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def lazy_exports(package: str, home: Mapping[str, str]) -> Callable[[str], Any]:
    """Return a module-level `__getattr__` (PEP 562) for a package, which imports an exported name when it is first used.

    The returned function raises AttributeError for a name that the package does not export.

    Args:
        package: Name of the package.
        home: For each exported name, the full name of the module that defines it.
    """

    def get(name: str) -> Any:
        if name not in home:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(home[name]), name)

    return get
