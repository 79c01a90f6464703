"""Find installed ROS packages by the ament index, and their executables, shared files and interfaces."""

from __future__ import annotations

import difflib
import importlib
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ament_index_python.packages import PackageNotFoundError, get_package_prefix, get_packages_with_prefixes
from ament_index_python.resources import get_resource, get_resources
from tt_core.errors import TtError

LAUNCH_FILES = ("*.launch.yaml",)
INTERFACE_KINDS = ("msg", "srv", "action")  # kinds of interfaces


class NotFound(TtError):
    """Error: no package, executable, launch file or interface of the given name is installed.

    Attributes:
        what: Kind of thing that was looked for, e.g. "Package".
        name: The name that was looked for.
        known: Up to 5 installed names that are similar; if none is similar, up to 30 that are installed.
    """

    def __init__(self, what: str, name: str, known: Iterable[str]) -> None:
        """Keep what was looked for, and the installed names that are most similar to it.

        Args:
            what: Kind of thing that was looked for, e.g. "Package".
            name: The name that was looked for.
            known: All installed names of this kind.
        """
        known = sorted(known)
        choices = difflib.get_close_matches(name, known, n=5, cutoff=0.5) or known[:30]
        super().__init__(f"{what} '{name}' not found" + (f"; there is {', '.join(choices)}" if choices else ""))
        self.what, self.name, self.known = what, name, choices


def package_names() -> list[str]:
    """Return the names of all installed packages, sorted."""
    return sorted(get_packages_with_prefixes())


def prefix(package: str) -> Path:
    """Return the folder in which a package is installed, its prefix. Raises NotFound if it is not installed."""
    try:
        return Path(get_package_prefix(package))
    except (PackageNotFoundError, ValueError):
        raise NotFound("Package", package, [name for name in package_names() if executables(name)]) from None


def share(package: str) -> Path:
    """Return the folder PREFIX/share/PACKAGE with the data files of a package. Raises NotFound if the package is not installed."""
    return prefix(package) / "share" / package


def executables(package: str) -> dict[str, Path]:
    """Return the paths of the executables of a package by name; empty if it has none. Raises NotFound if it is not installed."""
    folder = prefix(package) / "lib" / package
    return {path.name: path for path in sorted(folder.glob("*")) if path.is_file() and os.access(path, os.X_OK)}


def executable(package: str, name: str) -> Path:
    """Return the path of the executable `name` of a package. Raises NotFound if there is no such package or executable."""
    found = executables(package)
    if name not in found:
        raise NotFound(f"Executable of package '{package}'", name, found)
    return found[name]


def launch_files(package: str) -> dict[str, Path]:
    """Return the paths of the launch files of a package by name; empty if it has none. Raises NotFound if it is not installed."""
    return {path.name: path for pattern in LAUNCH_FILES for path in sorted(share(package).rglob(pattern))}


def launch_file(package: str, name: str) -> Path:
    """Return the path of the launch file `name` of a package. Raises NotFound if there is no such package or launch file."""
    found = launch_files(package)
    if name not in found:
        raise NotFound(f"Launch file of package '{package}'", name, found)
    return found[name]


def interfaces(kind: str) -> list[str]:
    """Return the full names of all installed interfaces of a kind, one of INTERFACE_KINDS, sorted; e.g. "std_msgs/msg/String"."""
    found = set[str]()
    for package in get_resources("rosidl_interfaces"):
        files = get_resource("rosidl_interfaces", package)[0].split()
        found |= {f"{package}/{file.rpartition('.')[0]}" for file in files if file.startswith(f"{kind}/") and file.endswith(f".{kind}")}
    return sorted(found)


def full_name(name: str, kind: str = "msg") -> str:
    """Return the full name of an interface. `kind`, one of INTERFACE_KINDS, is inserted into a short name such as std_msgs/String."""
    return name.replace("/", f"/{kind}/") if name.count("/") == 1 else name


def interface_file(name: str) -> Path:
    """Return the file that defines an interface, e.g. "std_msgs/msg/String". Raises NotFound if there is no such interface."""
    package, _, rest = name.partition("/")
    try:
        path = share(package) / f"{rest}.{rest.partition('/')[0]}"
    except NotFound:
        path = Path()
    if name.count("/") != 2 or not path.is_file():
        raise NotFound("Interface", name, [one for kind in INTERFACE_KINDS for one in interfaces(kind)])
    return path


def interface(name: str) -> Any:
    """Return the Python class of a message or service type, e.g. "sensor_msgs/msg/Image", "std_msgs/String" or "std_srvs/srv/Trigger".

    Raises:
        NotFound: There is no such type.
    """
    package, _, kind = full_name(name).rpartition("/")
    try:
        return getattr(importlib.import_module(package.replace("/", ".")), kind)
    except (ImportError, AttributeError, ValueError):
        known = [one for group in INTERFACE_KINDS for one in interfaces(group)]
        raise NotFound("Message or service type", name, difflib.get_close_matches(name, known, n=5, cutoff=0.5)) from None
