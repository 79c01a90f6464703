"""The command `ros2 launch`: start the processes of a launch file."""

from __future__ import annotations

import shlex
from argparse import Namespace
from dataclasses import replace
from pathlib import Path

from tt_core.errors import TtError

from .. import launch, packages
from .arguments import Verbs, complete, verb


def start(args: Namespace) -> int:
    """Run `ros2 launch`: start the processes of a launch file and wait for their end, or print its arguments or processes.

    The launch file is given by its path, or by a package and the name of one of its launch files. Arguments NAME:=VALUE may follow.

    Returns:
        Exit code: 1 if a process failed, otherwise 0.

    Raises:
        TtError: The command line is malformed, or the launch file does not exist.
    """
    words = [word for word in [args.package_name, *args.rest] if ":=" not in word]
    given = [word for word in args.rest if ":=" in word]
    if len(words) > 2 or any(word.startswith(":=") for word in given):
        wrong = words[2] if len(words) > 2 else given[0]
        raise TtError(f"malformed launch argument '{wrong}', expected format '<name>:=<value>'")
    path = Path(words[0]) if len(words) == 1 else packages.launch_file(*words)
    if len(words) == 1 and not path.is_file():
        raise TtError(f"no launch file {path}; give its path, or a package and its name")
    if args.show_args:
        print_arguments(path)
        return 0
    processes = launch.processes(path, dict(word.split(":=", 1) for word in given))
    if args.launch_prefix:
        prefix = tuple(shlex.split(args.launch_prefix))
        processes = [replace(process, command=(*prefix, *process.command)) for process in processes]
    if args.print_description:
        for process in processes:
            print(f"{process.name}: {shlex.join(process.command)}")
        return 0
    return launch.run_processes(processes)


def print_arguments(path: Path) -> None:
    """Print the arguments of a launch file with their descriptions and defaults, in the format of ros2cli."""
    print("Arguments (pass arguments as '<name>:=<value>'):")
    found = launch.declared_arguments(path)
    for argument in found:
        print(f"\n    '{argument.name}':\n        {argument.description or 'no description given'}")
        if argument.default is not None:
            print(f"        (default: {argument.default!r})")
    if not found:
        print("\n  No arguments.")


def add(words: Verbs) -> None:
    """Add the command `ros2 launch` to `words`, the subcommands of the `ros2` parser."""
    one = verb(words, "launch", start, "start the processes of a launch file")
    one.add_argument("-p", "--print-description", action="store_true", help="print the processes with their commands, and end")
    one.add_argument("-s", "--show-args", "--show-arguments", action="store_true", help="print the file's arguments, and end")
    one.add_argument("--launch-prefix", default="", metavar="COMMAND", help="command before every process, e.g. 'gdb -ex run --args'")
    complete(one.add_argument("package_name", help="a package, or the path of a launch file"), lambda _: packages.package_names())
    rest = one.add_argument("rest", nargs="*", metavar="FILE or NAME:=VALUE", help="the package's launch file; arguments for it")
    complete(rest, _complete)


def _complete(args: Namespace) -> list[str]:
    """Return completions: the launch files of the package, or the arguments of the launch file if it is given already."""
    if not args.rest:
        return list(packages.launch_files(args.package_name))
    return [f"{argument.name}:=" for argument in launch.declared_arguments(packages.launch_file(args.package_name, args.rest[0]))]
