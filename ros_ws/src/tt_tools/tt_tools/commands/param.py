"""The command `ros2 param`: list, get, set, describe, dump, load."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from .arguments import Verbs, add_discovery, add_node, complete, group, verb


def show_list(args: Namespace) -> None:
    """Run `ros2 param list`: print the names of the parameters of one node or of all nodes."""
    from ..parameter_client import print_names

    print_names(args.node_name, tuple(args.param_prefixes), hidden=args.include_hidden_nodes, types=args.param_type)


def get(args: Namespace) -> None:
    """Run `ros2 param get`: print the value of a parameter."""
    from ..parameter_client import show

    show(args.node_name, args.parameter_name, hide_type=args.hide_type)


def set_value(args: Namespace) -> None:
    """Run `ros2 param set`: set a parameter of a running node."""
    from ..parameter_client import set_value

    set_value(args.node_name, args.parameter_name, args.value)


def describe(args: Namespace) -> None:
    """Run `ros2 param describe`: print type, description and constraints of parameters."""
    from ..parameter_client import print_descriptions

    print_descriptions(args.node_name, args.parameter_names)


def dump(args: Namespace) -> None:
    """Run `ros2 param dump`: print all parameters of a node as a parameter file."""
    from ..parameter_client import dump

    print(dump(args.node_name), end="")


def load(args: Namespace) -> None:
    """Run `ros2 param load`: set the parameters of a parameter file on a running node."""
    from ..parameter_client import load

    load(args.node_name, args.parameter_file)


def _add_parameter(parser: ArgumentParser, name: str = "parameter_name", nargs: str | None = None) -> None:
    def known(args: Namespace) -> list[str]:
        from ..parameter_client import connected

        with connected(args.node_name) as client:
            return client.names()

    complete(parser.add_argument(name, nargs=nargs, help="name of the parameter"), known)


def add(words: Verbs) -> None:
    """Add the command `ros2 param` and its verbs to `words`, the subcommands of the `ros2` parser."""
    verbs = group(words, "param", "look at and set parameters of running nodes")
    one = verb(verbs, "list", show_list, "name the parameters of all nodes, or of one")
    add_node(one, nargs="?")
    one.add_argument("--include-hidden-nodes", action="store_true", help="nodes that begin with _, too")
    one.add_argument("--param-prefixes", nargs="+", default=[], metavar="PREFIX", help="only those that begin so")
    one.add_argument("--param-type", action="store_true", help="with their types")
    add_discovery(one)
    one = verb(verbs, "get", get, "print the value of a parameter")
    add_node(one)
    _add_parameter(one)
    one.add_argument("--hide-type", action="store_true", help="print the value only")
    one = verb(verbs, "set", set_value, "set a parameter")
    add_node(one)
    _add_parameter(one)
    one.add_argument("value", help="in YAML")
    one = verb(verbs, "describe", describe, "print type, meaning and bounds of parameters")
    add_node(one)
    _add_parameter(one, "parameter_names", "+")
    one = verb(verbs, "dump", dump, "print all parameters of a node as a parameter file")
    add_node(one)
    one = verb(verbs, "load", load, "set the parameters of a file on a running node")
    add_node(one)
    one.add_argument("parameter_file", type=Path)
