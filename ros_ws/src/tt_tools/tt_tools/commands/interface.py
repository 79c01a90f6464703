"""The command `ros2 interface`: show, list, package, proto."""

from __future__ import annotations

import sys
from argparse import Namespace

from .. import packages
from .arguments import Verbs, add_package, complete, group, verb


def _known(_: Namespace) -> list[str]:
    return [one for kind in packages.INTERFACE_KINDS for one in packages.interfaces(kind)]


def show(args: Namespace) -> None:
    """Run `ros2 interface show`: print the definition of a message, service or action type."""
    from ..interface_text import definition

    name = sys.stdin.readline().strip() if args.type == "-" else args.type
    print("\n".join(definition(name, comments=not args.no_comments, nested_comments=args.all_comments)))


def show_list(args: Namespace) -> None:
    """Run `ros2 interface list`: print the names of all installed message, service and action types."""
    wanted = [args.only_msgs, args.only_srvs, args.only_actions]
    for kind, title, chosen in zip(packages.INTERFACE_KINDS, ("Messages", "Services", "Actions"), wanted, strict=True):
        if chosen or not any(wanted):
            print(f"{title}:")
            for name in packages.interfaces(kind):
                print(f"    {name}")


def package(args: Namespace) -> None:
    """Run `ros2 interface package`: print the names of the types of a package."""
    packages.prefix(args.package_name)
    for name in _known(args):
        if name.startswith(f"{args.package_name}/"):
            print(name)


def proto(args: Namespace) -> None:
    """Run `ros2 interface proto`: print the default values of a type as YAML, for use in ros2 topic pub and ros2 service call."""
    from ..message_text import to_yaml

    made = packages.interface(args.type)
    text = to_yaml(getattr(made, "Request", made)())
    print(text if args.no_quotes else f'"{text}"')


def add(words: Verbs) -> None:
    """Add the command `ros2 interface` and its verbs to `words`, the subcommands of the `ros2` parser."""
    verbs = group(words, "interface", "look at message, service and action types")
    one = verb(verbs, "show", show, "print the definition of a type")
    complete(one.add_argument("type", help="e.g. nav_msgs/msg/Odometry; - reads it from standard input"), _known)
    comments = one.add_mutually_exclusive_group()
    comments.add_argument("--all-comments", action="store_true", help="comments of nested types, too")
    comments.add_argument("--no-comments", action="store_true", help="no comments and no empty lines")
    one = verb(verbs, "list", show_list, "name all types")
    one.add_argument("-m", "--only-msgs", action="store_true")
    one.add_argument("-s", "--only-srvs", action="store_true")
    one.add_argument("-a", "--only-actions", action="store_true")
    add_package(verb(verbs, "package", package, "name the types of a package"))
    one = verb(verbs, "proto", proto, "print the default values of a type")
    complete(one.add_argument("type", help="e.g. std_msgs/msg/String"), _known)
    one.add_argument("--no-quotes", action="store_true")
