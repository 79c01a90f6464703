"""The command `ros2 pkg`: list, executables, prefix."""

from __future__ import annotations

from argparse import Namespace

from .. import packages
from .arguments import Verbs, add_package, group, verb


def show_list(_: Namespace) -> None:
    """Run `ros2 pkg list`: print the names of all installed packages."""
    print("\n".join(packages.package_names()))


def executables(args: Namespace) -> None:
    """Run `ros2 pkg executables`: print the executables of one package or of all packages."""
    for package in [args.package_name] if args.package_name else packages.package_names():
        for name, path in packages.executables(package).items():
            print(path if args.full_path else f"{package} {name}")


def prefix(args: Namespace) -> None:
    """Run `ros2 pkg prefix`: print the folder in which a package is installed, or that of its data files."""
    print(packages.share(args.package_name) if args.share else packages.prefix(args.package_name))


def add(words: Verbs) -> None:
    """Add the command `ros2 pkg` and its verbs to `words`, the subcommands of the `ros2` parser."""
    verbs = group(words, "pkg", "look at packages")
    verb(verbs, "list", show_list, "name the packages")
    one = verb(verbs, "executables", executables, "name the executables of a package, or of all")
    add_package(one, nargs="?")
    one.add_argument("--full-path", action="store_true", help="print their paths")
    one = verb(verbs, "prefix", prefix, "print where a package is installed")
    add_package(one)
    one.add_argument("--share", action="store_true", help="print the folder of its data files")
