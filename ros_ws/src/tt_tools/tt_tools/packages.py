"""What is installed: executables, shared files and message types of ROS packages, by the ament index."""

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
    """Nothing of that name; says what there is."""

    def __init__(self, what: str, name: str, known: Iterable[str]) -> None:
        known = sorted(known)
        choices = difflib.get_close_matches(name, known, n=5, cutoff=0.5) or known[:30]
        super().__init__(f"no {what} {name!r}; there is {', '.join(choices) or 'none'}")


def prefix(package: str) -> Path:
    """Where `package` is installed. Raises NotFound."""
    try:
        return Path(get_package_prefix(package))
    except (PackageNotFoundError, ValueError):
        raise NotFound("package", package, get_packages_with_prefixes()) from None


def share(package: str) -> Path:
    """The folder of the data files of `package`. Raises NotFound."""
    return prefix(package) / "share" / package


def executable(package: str, name: str) -> Path:
    """Raises NotFound with the executables of `package`."""
    folder = prefix(package) / "lib" / package
    found = {path.name: path for path in folder.glob("*") if path.is_file() and os.access(path, os.X_OK)}
    if name not in found:
        raise NotFound(f"executable in {package}", name, found)
    return found[name]


def launch_file(package: str, name: str) -> Path:
    """Raises NotFound with the launch files of `package`."""
    found = {path.name: path for path in share(package).rglob("*.launch.yaml")}
    if name not in found:
        raise NotFound(f"launch file in {package}", name, found)
    return found[name]


def interface(name: str) -> Any:
    """The class of e.g. "sensor_msgs/msg/Image" or "std_srvs/srv/Trigger". Raises NotFound."""
    package, _, kind = name.rpartition("/")
    try:
        return getattr(importlib.import_module(package.replace("/", ".")), kind)
    except (ImportError, AttributeError, ValueError):
        raise NotFound("message or service type", name, ()) from None
