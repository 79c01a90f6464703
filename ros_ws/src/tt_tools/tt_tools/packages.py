"""Executables, shared files and message types of installed ROS packages, found by the ament index."""

from __future__ import annotations

import difflib
import importlib
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ament_index_python.packages import PackageNotFoundError, get_package_prefix, get_packages_with_prefixes
from tt_core.errors import TtError


class NotFound(TtError):
    """Nothing of that name is installed.

    Attributes:
        what: What was looked for, e.g. "package".
        name: Its name.
        known: Names that are there, similar ones if there are any.
    """

    def __init__(self, what: str, name: str, known: Iterable[str]) -> None:
        """Keep what was looked for, and the names most similar to it."""
        known = sorted(known)
        choices = difflib.get_close_matches(name, known, n=5, cutoff=0.5) or known[:30]
        super().__init__(f"no {what} {name!r}; there is {', '.join(choices) or 'none'}")
        self.what, self.name, self.known = what, name, choices


def prefix(package: str) -> Path:
    """Return the folder in which a package is installed. Raises NotFound."""
    try:
        return Path(get_package_prefix(package))
    except (PackageNotFoundError, ValueError):
        raise NotFound("package", package, get_packages_with_prefixes()) from None


def share(package: str) -> Path:
    """Return the folder of the data files of a package. Raises NotFound."""
    return prefix(package) / "share" / package


def executable(package: str, name: str) -> Path:
    """Return the path of an executable of a package. Raises NotFound."""
    folder = prefix(package) / "lib" / package
    found = {path.name: path for path in folder.glob("*") if path.is_file() and os.access(path, os.X_OK)}
    if name not in found:
        raise NotFound(f"executable in {package}", name, found)
    return found[name]


def launch_file(package: str, name: str) -> Path:
    """Return the path of a launch file of a package. Raises NotFound."""
    found = {path.name: path for path in share(package).rglob("*.launch.yaml")}
    if name not in found:
        raise NotFound(f"launch file in {package}", name, found)
    return found[name]


def interface(name: str) -> Any:
    """Return the class of a message or service type, e.g. "sensor_msgs/msg/Image" or "std_srvs/srv/Trigger". Raises NotFound."""
    package, _, kind = name.rpartition("/")
    try:
        return getattr(importlib.import_module(package.replace("/", ".")), kind)
    except (ImportError, AttributeError, ValueError):
        raise NotFound("message or service type", name, ()) from None
