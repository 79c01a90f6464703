"""The command `ros2 run`: run an executable of a package."""

from __future__ import annotations

import argparse
import os
import shlex
import shutil

from tt_core.errors import TtError

from .. import packages
from .arguments import Verbs, add_package, complete, verb


def run(args: argparse.Namespace) -> None:
    """Run `ros2 run`: replace this process by an executable of a package. Raises TtError if its program is not found."""
    program = packages.executable(args.package_name, args.executable_name)
    command = [*shlex.split(args.prefix), str(program), *args.argv]
    if not (path := shutil.which(command[0])):
        raise TtError(f"there is no program {command[0]}")
    os.execv(path, command)


def add(words: Verbs) -> None:
    """Add the command `ros2 run` to `words`, the subcommands of the `ros2` parser."""
    one = verb(words, "run", run, "run an executable of a package")
    one.add_argument("--prefix", default="", metavar="COMMAND", help="command before the executable, e.g. 'gdb -ex run --args'")
    add_package(one)
    name = one.add_argument("executable_name", help="name of the executable")
    complete(name, lambda args: packages.executables(args.package_name))
    one.add_argument("argv", nargs=argparse.REMAINDER, help="for the executable")
