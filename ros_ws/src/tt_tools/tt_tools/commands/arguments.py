"""Types, groups and completions of arguments that several verbs share."""

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
    """Add a word that has verbs, and return what takes them."""
    return words.add_parser(name, help=about, description=about).add_subparsers(metavar="VERB", required=True)


def verb(among: Verbs, name: str, act: Callable[[Namespace], int | None], about: str) -> ArgumentParser:
    """Add a verb. act: Takes the arguments, and returns the exit code, None for 0."""
    made: ArgumentParser = among.add_parser(name, help=about, description=about)
    made.set_defaults(act=act)
    return made


def positive(text: str) -> float:
    """Return a number greater than 0."""
    value = float(text)
    if value <= 0.0:
        raise ArgumentTypeError(f"{text} is not positive")
    return value


def not_negative(text: str) -> float:
    """Return a number that is not below 0."""
    value = float(text)
    if value < 0.0:
        raise ArgumentTypeError(f"{text} is negative")
    return value


def count(text: str) -> int:
    """Return a whole number that is not below 0."""
    value = int(text)
    if value < 0:
        raise ArgumentTypeError(f"{text} is negative")
    return value


def renaming(text: str) -> tuple[str, str]:
    """Return old and new name of OLD:=NEW."""
    old, separator, new = text.partition(":=")
    if not (old and separator and new):
        raise ArgumentTypeError(f"{text} is not OLD:=NEW")
    return old, new


def complete(argument: argparse.Action, choices: Callable[[Namespace], Iterable[str]]) -> None:
    """Let the shell complete an argument by what `choices` returns for the arguments before it."""
    argument.completer = lambda prefix, parsed_args, **_: list(choices(parsed_args))  # type: ignore[attr-defined]


def add_package(parser: ArgumentParser, **options: Any) -> None:
    """Add the name of a package."""
    complete(parser.add_argument("package_name", help="name of the ROS package", **options), lambda _: packages.names())


def add_discovery(parser: ArgumentParser) -> None:
    """Add the options about discovery."""
    parser.add_argument("--spin-time", type=not_negative, metavar="S", help="time to wait for discovery; until it is complete unless given")
    parser.add_argument("--no-daemon", action="store_true", help="accepted: there is no daemon here")


def known(what: str) -> Callable[[Namespace], list[str]]:
    """Return a completion by the names of the graph's "topics", "nodes" or "services"."""

    def names(_: Namespace) -> list[str]:
        from .. import graph

        with graph.graph() as node:
            return list(getattr(graph, what)(node))

    return names


def add_topic(parser: ArgumentParser, name: str = "topic_name") -> None:
    """Add the name of a topic."""
    complete(parser.add_argument(name, help="name of the ROS topic, e.g. /ball/measured"), known("topics"))


def add_node(parser: ArgumentParser, **options: Any) -> None:
    """Add the name of a node."""
    complete(parser.add_argument("node_name", help="name of the ROS node, e.g. /arm", **options), known("nodes"))


def add_service(parser: ArgumentParser) -> None:
    """Add the name of a service."""
    complete(parser.add_argument("service_name", help="name of the ROS service, e.g. /arm/enable"), known("services"))


def add_type(parser: ArgumentParser, name: str, kind: str, **options: Any) -> None:
    """Add the name of an interface of one of packages.KINDS."""
    argument = parser.add_argument(name, help=f"type, e.g. {'std_msgs/msg/String' if kind == 'msg' else 'std_srvs/srv/Trigger'}", **options)
    complete(argument, lambda _: packages.interfaces(kind))


def add_qos(parser: ArgumentParser) -> None:
    """Add the options about quality of service."""
    profiles = ("default", "sensor_data", "system_default", "services_default", "parameters", "parameter_events")
    parser.add_argument("--qos-profile", default="", choices=profiles, help="preset profile")
    parser.add_argument("--qos-depth", type=count, metavar="N", help="messages that may wait")
    parser.add_argument("--qos-history", default="", choices=("system_default", "keep_last", "keep_all"))
    parser.add_argument("--qos-reliability", default="", choices=("system_default", "reliable", "best_effort"))
    parser.add_argument("--qos-durability", default="", choices=("system_default", "transient_local", "volatile"))
    parser.add_argument("--qos-liveliness", default="", choices=("system_default", "automatic", "manual_by_topic"))
    parser.add_argument("--qos-liveliness-lease-duration-seconds", type=positive, metavar="S")


def qos_words(args: Namespace) -> QosWords:
    """Return what the options of `add_qos` say."""
    from ..qos import QosWords

    lease = args.qos_liveliness_lease_duration_seconds
    words = (args.qos_history, args.qos_reliability, args.qos_durability, args.qos_liveliness)
    return QosWords(args.qos_profile, args.qos_depth, *words, lease)
