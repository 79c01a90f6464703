"""Parts of the command line that several `ros2` commands share: groups of verbs, types of arguments, common arguments, shell completion."""

from __future__ import annotations

import argparse
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from .. import packages

if TYPE_CHECKING:
    from ..qos import QosWords

Verbs = Any  # what ArgumentParser.add_subparsers returns


def group(words: Verbs, name: str, about: str) -> Verbs:
    """Add a command that has verbs, e.g. `ros2 topic`.

    Args:
        words: Subcommands of the `ros2` parser, to which the command is added.
        name: Name of the command, e.g. "topic".
        about: Help text.

    Returns:
        Subcommands of the new command, to which `verb` adds its verbs.
    """
    return words.add_parser(name, help=about, description=about).add_subparsers(metavar="VERB", required=True)


def verb(among: Verbs, name: str, act: Callable[[Namespace], int | None], about: str) -> ArgumentParser:
    """Add a verb, e.g. `list` of `ros2 topic`.

    Args:
        among: Subcommands to which the verb is added, as `group` returns them.
        name: Name of the verb.
        act: Function that runs the verb. It takes the parsed arguments and returns the exit code, None for 0.
        about: Help text.

    Returns:
        Parser of the verb, to which its arguments can be added.
    """
    made: ArgumentParser = among.add_parser(name, help=about, description=about)
    made.set_defaults(act=act)
    return made


def positive(text: str) -> float:
    """Convert the text of an argument to a number. Raises ArgumentTypeError if it is not greater than 0."""
    value = float(text)
    if value <= 0.0:
        raise ArgumentTypeError(f"{text} is not positive")
    return value


def not_negative(text: str) -> float:
    """Convert the text of an argument to a number. Raises ArgumentTypeError if it is negative."""
    value = float(text)
    if value < 0.0:
        raise ArgumentTypeError(f"{text} is negative")
    return value


def count(text: str) -> int:
    """Convert the text of an argument to a whole number. Raises ArgumentTypeError if it is negative."""
    value = int(text)
    if value < 0:
        raise ArgumentTypeError(f"{text} is negative")
    return value


def renaming(text: str) -> tuple[str, str]:
    """Split the text OLD:=NEW of an argument into the old and the new name. Raises ArgumentTypeError for other texts."""
    old, separator, new = text.partition(":=")
    if not (old and separator and new):
        raise ArgumentTypeError(f"{text} is not OLD:=NEW")
    return old, new


def complete(argument: argparse.Action, choices: Callable[[Namespace], Iterable[str]]) -> None:
    """Set which values the shell offers to complete an argument.

    Args:
        argument: The argument, as `add_argument` returns it.
        choices: Function that returns the values. It takes the arguments that are parsed so far.
    """
    argument.completer = lambda prefix, parsed_args, **_: list(choices(parsed_args))  # type: ignore[attr-defined]


def add_package(parser: ArgumentParser, **options: Any) -> None:
    """Add the argument `package_name`, with completion, to a parser. options: keywords of `add_argument`, e.g. nargs."""
    complete(parser.add_argument("package_name", help="name of the ROS package", **options), lambda _: packages.package_names())


def add_discovery(parser: ArgumentParser) -> None:
    """Add the options about the discovery of the graph, --spin-time and --no-daemon, to a parser."""
    parser.add_argument("--spin-time", type=not_negative, metavar="S", help="time to wait for discovery; until it is complete unless given")
    parser.add_argument("--no-daemon", action="store_true", help="accepted: there is no daemon here")


def known(what: str) -> Callable[[Namespace], list[str]]:
    """Return a function for `complete` that lists the names of all topics, nodes or services of the ROS graph.

    Args:
        what: "topics", "nodes" or "services".
    """

    def names(_: Namespace) -> list[str]:
        from .. import graph

        with graph.graph() as node:
            return list(getattr(graph, what)(node))

    return names


def add_topic(parser: ArgumentParser, name: str = "topic_name") -> None:
    """Add an argument for the name of a topic, with completion, to a parser. name: of the argument in the parsed arguments."""
    complete(parser.add_argument(name, help="name of the ROS topic, e.g. /ball/measured"), known("topics"))


def add_node(parser: ArgumentParser, **options: Any) -> None:
    """Add the argument `node_name`, with completion, to a parser. options: keywords of `add_argument`, e.g. nargs."""
    complete(parser.add_argument("node_name", help="name of the ROS node, e.g. /arm", **options), known("nodes"))


def add_service(parser: ArgumentParser) -> None:
    """Add the argument `service_name`, the name of a ROS service, with completion, to a parser."""
    complete(parser.add_argument("service_name", help="name of the ROS service, e.g. /arm/enable"), known("services"))


def add_type(parser: ArgumentParser, name: str, kind: str, **options: Any) -> None:
    """Add an argument for the name of an interface type, with completion, to a parser.

    Args:
        parser: The parser of a verb.
        name: Name of the argument in the parsed arguments.
        kind: Kind of the interface, one of packages.KINDS.
        **options: Keywords of `add_argument`, e.g. nargs.
    """
    argument = parser.add_argument(name, help=f"type, e.g. {'std_msgs/msg/String' if kind == 'msg' else 'std_srvs/srv/Trigger'}", **options)
    complete(argument, lambda _: packages.interfaces(kind))


def add_qos(parser: ArgumentParser) -> None:
    """Add the quality-of-service options of ros2cli (--qos-...) to a parser."""
    profiles = ("default", "sensor_data", "system_default", "services_default", "parameters", "parameter_events")
    parser.add_argument("--qos-profile", default="", choices=profiles, help="preset profile")
    parser.add_argument("--qos-depth", type=count, metavar="N", help="messages that may wait")
    parser.add_argument("--qos-history", default="", choices=("system_default", "keep_last", "keep_all"))
    parser.add_argument("--qos-reliability", default="", choices=("system_default", "reliable", "best_effort"))
    parser.add_argument("--qos-durability", default="", choices=("system_default", "transient_local", "volatile"))
    parser.add_argument("--qos-liveliness", default="", choices=("system_default", "automatic", "manual_by_topic"))
    parser.add_argument("--qos-liveliness-lease-duration-seconds", type=positive, metavar="S")


def qos_words(args: Namespace) -> QosWords:
    """Return the values of the options that `add_qos` has added, from the parsed arguments."""
    from ..qos import QosWords

    lease = args.qos_liveliness_lease_duration_seconds
    words = (args.qos_history, args.qos_reliability, args.qos_durability, args.qos_liveliness)
    return QosWords(args.qos_profile, args.qos_depth, *words, lease)
