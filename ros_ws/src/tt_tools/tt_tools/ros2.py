"""The verbs of ros2cli that this project uses, for machines without it: run, launch, bag, topic, service, param, node."""

from __future__ import annotations

import argparse
import json
import os
import sys
from datetime import datetime
from pathlib import Path

from tt_core.errors import TtError

from . import launch, packages


def positive(text: str) -> float:
    """Return a number that is greater than 0, for argparse."""
    value = float(text)
    if value <= 0.0:
        raise argparse.ArgumentTypeError(f"{text} is not positive")
    return value


def renaming(text: str) -> tuple[str, str]:
    """Return old and new name of OLD:=NEW, for argparse."""
    old, separator, new = text.partition(":=")
    if not (old and separator and new):
        raise argparse.ArgumentTypeError(f"{text} is not OLD:=NEW")
    return old, new


def run(args: argparse.Namespace) -> None:
    """Replace this process by the executable of a package."""
    program = packages.executable(args.package, args.executable)
    os.execv(program, [str(program), *args.args])


def start(args: argparse.Namespace) -> int:
    """Start the processes of a launch file.

    The words are a path alone, or a package and the name of one of its launch files; NAME:=VALUE may stand after either.
    """
    words = [word for word in [args.package_or_path, *args.rest] if ":=" not in word]
    if len(words) > 2:
        raise TtError(f"{words[2]!r} is no name:=value")
    path = Path(words[0]) if len(words) == 1 else packages.launch_file(*words)
    if len(words) == 1 and not path.is_file():
        raise TtError(f"no launch file {path}; give its path, or a package and its name")
    if args.show_args:
        for argument in launch.arguments(path):
            print(f"{argument.name}\t{'(needed)' if argument.default is None else repr(argument.default)}\t{argument.description}")
        return 0
    return launch.run(launch.processes(path, dict(word.split(":=", 1) for word in args.rest if ":=" in word)))


def record(args: argparse.Namespace) -> None:
    """Replace this process by the recorder."""
    topics = [*args.topics, *args.more_topics]
    if bool(topics) == args.all:
        raise TtError("give either topics or -a")
    output = args.output or datetime.now().strftime("rosbag2_%Y_%m_%d-%H_%M_%S")
    wanted = {"output": output, "topics": topics, "exclude": args.exclude_regex}
    parameters = [word for name, value in wanted.items() if value for word in ("-p", f"{name}:={json.dumps(value)}")]
    program = packages.executable("tt_tools", "record_node")
    os.execv(program, [str(program), "--ros-args", *parameters])


def play(args: argparse.Namespace) -> None:
    """Publish what a bag holds."""
    from .play_node import PlayParams, play

    params = PlayParams(str(args.bag), args.rate, args.clock or 0.0, tuple(args.topics), args.delay)
    print(f"played {play(params, dict(args.remap))} messages")


def info(args: argparse.Namespace) -> None:
    """Print what a bag holds."""
    from rich.console import Console

    from .reindex import describe

    Console(width=None if sys.stdout.isatty() else 160).print(describe(args.bag))


def reindex(args: argparse.Namespace) -> None:
    """Make a bag readable whose recorder was killed."""
    from .reindex import reindex

    print(reindex(args.bag))


def topic_list(args: argparse.Namespace) -> None:
    """Print the names of all topics."""
    from .graph_node import topics

    for name, types in topics().items():
        print(f"{name} [{', '.join(types)}]" if args.show_types else name)


def topic_echo(args: argparse.Namespace) -> None:
    """Print the messages of a topic."""
    from .graph_node import echo

    echo(args.topic, once=args.once)


def topic_hz(args: argparse.Namespace) -> None:
    """Print the rate of a topic."""
    from .graph_node import rate

    rate(args.topic, args.window)


def service_call(args: argparse.Namespace) -> None:
    """Call a service and print its response."""
    from .graph_node import call

    call(args.service, args.type, args.values)


def param_list(args: argparse.Namespace) -> None:
    """Print the names of parameters."""
    from .graph_node import nodes
    from .parameter_client import list_names

    list_names([args.node] if args.node else nodes(), single=bool(args.node))


def param_get(args: argparse.Namespace) -> None:
    """Print the value of a parameter."""
    from .parameter_client import show

    show(args.node, args.name, hide_type=args.hide_type)


def param_set(args: argparse.Namespace) -> None:
    """Set a parameter."""
    from .parameter_client import set_value

    set_value(args.node, args.name, args.value)


def param_describe(args: argparse.Namespace) -> None:
    """Print what a node tells about parameters."""
    from .parameter_client import describe

    describe(args.node, args.names)


def param_dump(args: argparse.Namespace) -> None:
    """Print the parameters of a node as a file."""
    from .parameter_client import dump

    dump(args.node)


def param_load(args: argparse.Namespace) -> None:
    """Set the parameters of a file."""
    from .parameter_client import load

    load(args.node, args.file)


def node_list(_: argparse.Namespace) -> None:
    """Print the names of all nodes."""
    from .graph_node import nodes

    print("\n".join(nodes()))


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    top = argparse.ArgumentParser(prog="ros2", description=__doc__)
    words = top.add_subparsers(metavar="WORD", required=True)

    def group(name: str, about: str) -> argparse._SubParsersAction:
        return words.add_parser(name, help=about, description=about).add_subparsers(metavar="VERB", required=True)

    def verb(among: argparse._SubParsersAction, name: str, act: object, about: str) -> argparse.ArgumentParser:
        made = among.add_parser(name, help=about, description=about)
        made.set_defaults(act=act)
        return made

    one = verb(words, "run", run, "run an executable of a package")
    one.add_argument("package")
    one.add_argument("executable")
    one.add_argument("args", nargs=argparse.REMAINDER, help="for the executable")

    one = verb(words, "launch", start, "start the processes of a launch file")
    one.add_argument("-s", "--show-args", action="store_true", help="tell the file's arguments and end")
    one.add_argument("package_or_path")
    one.add_argument("rest", nargs="*", metavar="FILE or NAME:=VALUE", help="the package's launch file; arguments for it")

    bag = group("bag", "record topics and play them back")
    one = verb(bag, "record", record, "record topics")
    one.add_argument("topics", nargs="*")
    one.add_argument("--topics", dest="more_topics", nargs="+", default=[], metavar="TOPIC")
    one.add_argument("-a", "--all", action="store_true", help="all topics")
    one.add_argument("--exclude-regex", default="", metavar="REGEX", help="but not those in which this is found")
    one.add_argument("-o", "--output", metavar="DIR", help="a new directory; named by the time unless given")
    one = verb(bag, "play", play, "publish what was recorded")
    one.add_argument("bag", type=Path)
    one.add_argument("-r", "--rate", type=positive, default=1.0, help="recorded seconds in a second")
    one.add_argument("--clock", type=positive, nargs="?", const=40.0, metavar="HZ", help="publish /clock, 40 times a second unless given")
    one.add_argument("-d", "--delay", type=positive, default=0.0, metavar="S", help="seconds to wait first")
    one.add_argument("--topics", nargs="+", default=[], metavar="TOPIC", help="only these")
    one.add_argument("-m", "--remap", nargs="+", type=renaming, default=[], metavar="OLD:=NEW")
    one = verb(bag, "info", info, "tell what a bag holds")
    one.add_argument("bag", type=Path)
    one = verb(bag, "reindex", reindex, "make a bag readable whose recorder was killed")
    one.add_argument("bag", type=Path)

    topic = group("topic", "look at topics")
    one = verb(topic, "list", topic_list, "name the topics")
    one.add_argument("-t", "--show-types", action="store_true")
    one = verb(topic, "echo", topic_echo, "print the messages of a topic")
    one.add_argument("topic")
    one.add_argument("--once", action="store_true", help="end after the first")
    one = verb(topic, "hz", topic_hz, "print the rate of a topic every second")
    one.add_argument("topic")
    one.add_argument("-w", "--window", type=int, default=10000, help="messages to average over")

    service = group("service", "use services")
    one = verb(service, "call", service_call, "call a service and print its response")
    one.add_argument("service")
    one.add_argument("type", help="e.g. std_srvs/srv/Trigger")
    one.add_argument("values", nargs="?", default="{}", help="the request in YAML, e.g. '{data: true}'")

    param = group("param", "look at and set parameters of running nodes")
    one = verb(param, "list", param_list, "name the parameters of all nodes, or of one")
    one.add_argument("node", nargs="?", help="e.g. /arm")
    one = verb(param, "get", param_get, "print the value of a parameter")
    one.add_argument("node", help="e.g. /arm")
    one.add_argument("name")
    one.add_argument("--hide-type", action="store_true", help="print the value only")
    one = verb(param, "set", param_set, "set a parameter")
    one.add_argument("node", help="e.g. /arm")
    one.add_argument("name")
    one.add_argument("value", help="in YAML")
    one = verb(param, "describe", param_describe, "print type, meaning and bounds of parameters")
    one.add_argument("node", help="e.g. /arm")
    one.add_argument("names", nargs="+", metavar="name")
    one = verb(param, "dump", param_dump, "print all parameters of a node as a parameter file")
    one.add_argument("node", help="e.g. /arm")
    one = verb(param, "load", param_load, "set the parameters of a file on a running node")
    one.add_argument("node", help="e.g. /arm")
    one.add_argument("file", type=Path)

    node = group("node", "look at nodes")
    verb(node, "list", node_list, "name the nodes")
    return top


def main(words: list[str] | None = None) -> int:
    """Run one verb and return the exit code."""
    args = parser().parse_args(words)
    try:
        return args.act(args) or 0
    except TtError as error:
        print(f"ros2: {error}", file=sys.stderr)
        return 1
    except (KeyboardInterrupt, BrokenPipeError):
        return 130


if __name__ == "__main__":
    sys.exit(main())
