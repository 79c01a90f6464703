"""Write the pages of the API from the docstrings: python docs/api.py FOLDER. Any warning is an error."""

from __future__ import annotations

import importlib
import pkgutil
import sys
import typing
import warnings
from pathlib import Path

import pdoc

PACKAGES = ("tt_core", "tt_vision", "tt_predict", "tt_racket", "tt_arm", "tt_sim", "tt_eval", "tt_tools", "tt_bringup")


def modules() -> list[str]:
    """Import all modules of all packages and return their names."""
    names = list(PACKAGES)
    for package in map(importlib.import_module, PACKAGES):
        names += [module.name for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")]
    for name in names:
        importlib.import_module(name)
    return names


def resolve_named_tuples(name: str) -> None:
    """Turn the annotations of NamedTuples into types, because pdoc looks for their names in another module."""
    for kind in vars(sys.modules[name]).values():
        if isinstance(kind, type) and issubclass(kind, tuple) and hasattr(kind, "_fields") and kind.__module__ == name:
            kind.__new__.__annotations__ = typing.get_type_hints(kind)


def main() -> None:
    """Write the pages."""
    if len(sys.argv) != 2:
        raise SystemExit(__doc__)
    for name in modules():
        resolve_named_tuples(name)
    warnings.simplefilter("error")
    pdoc.render.configure(docformat="google", show_source=False)
    pdoc.pdoc(*PACKAGES, output_directory=Path(sys.argv[1]))


if __name__ == "__main__":
    main()
