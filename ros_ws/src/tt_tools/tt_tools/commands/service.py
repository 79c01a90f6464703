"""The command `ros2 service`: list, type, find, call."""

from __future__ import annotations

from argparse import Namespace

from .arguments import Verbs, add_discovery, add_service, add_type, group, positive, verb


def show_list(args: Namespace) -> None:
    """Run `ros2 service list`: print the names of all services."""
    from ..graph import graph, services

    with graph(args.spin_time) as node:
        found = services(node, hidden=args.include_hidden_services)
    if args.count_services:
        print(len(found))
        return
    for name, types in found.items():
        print(f"{name} [{', '.join(types)}]" if args.show_types else name)


def show_type(args: Namespace) -> int:
    """Run `ros2 service type`: print the type of a service. Returns the exit code, 1 if there is no such service."""
    from ..graph import graph, services

    with graph(args.spin_time) as node:
        types = services(node, hidden=True).get(node.resolve_service_name(args.service_name), [])
    print("\n".join(types), end="\n" if types else "")
    return 0 if types else 1


def find(args: Namespace) -> None:
    """Run `ros2 service find`: print the names of the services that have a given type."""
    from ..graph import graph, services
    from ..packages import full_name

    with graph(args.spin_time) as node:
        found = [name for name, types in services(node).items() if full_name(args.service_type, "srv") in types]
    print("\n".join(found), end="\n" if found else "")


def call(args: Namespace) -> None:
    """Run `ros2 service call`: call a service, once or at a rate, and print its response."""
    from ..call import call
    from ..packages import full_name

    period = 1.0 / args.rate if args.rate else None
    call(args.service_name, full_name(args.service_type, "srv"), args.values, period)


def add(words: Verbs) -> None:
    """Add the command `ros2 service` and its verbs to `words`, the subcommands of the `ros2` parser."""
    verbs = group(words, "service", "look at services, and call them")
    one = verb(verbs, "list", show_list, "name the services")
    one.add_argument("-t", "--show-types", action="store_true", help="with their types")
    one.add_argument("-c", "--count-services", action="store_true", help="print how many there are")
    one.add_argument("--include-hidden-services", action="store_true", help="those that begin with _, too")
    add_discovery(one)
    one = verb(verbs, "type", show_type, "print the type of a service")
    add_service(one)
    add_discovery(one)
    one = verb(verbs, "find", find, "name the services of a type")
    add_type(one, "service_type", "srv")
    add_discovery(one)
    one = verb(verbs, "call", call, "call a service and print its response")
    add_service(one)
    add_type(one, "service_type", "srv")
    one.add_argument("values", nargs="?", default="{}", help="the request in YAML, e.g. '{data: true}'")
    one.add_argument("-r", "--rate", type=positive, metavar="HZ", help="call again and again")
