"""The command `ros2 node`: list, info."""

from __future__ import annotations

import sys
from argparse import Namespace
from typing import TYPE_CHECKING

from ..errors import GraphError
from .arguments import Verbs, add_discovery, add_node, group, verb

if TYPE_CHECKING:
    from rclpy.node import Node


def show_list(args: Namespace) -> None:
    """Run `ros2 node list`: print the names of all nodes."""
    from ..graph import graph, nodes

    with graph(args.spin_time) as node:
        found = nodes(node, hidden=args.all)
    if args.count_nodes:
        print(len(found))
        return
    if len(set(found)) < len(found):
        text = "Be aware that there are nodes in the graph that share an exact name, which can have unintended side effects."
        print(f"WARNING: {text}", file=sys.stderr)
    print("\n".join(found), end="\n" if found else "")


def info(args: Namespace) -> None:
    """Run `ros2 node info`: print the topics, services and actions that a node uses and offers."""
    from ..graph import appears, graph, nodes

    with graph(args.spin_time) as node:
        name = f"/{args.node_name.lstrip('/')}"
        if not appears(lambda: name in nodes(node, hidden=True)):
            raise GraphError(f"Unable to find node '{args.node_name}'")
        if (count := nodes(node, hidden=True).count(name)) > 1:
            print(f'There are {count} nodes in the graph with the exact name "{name}". You are seeing information about only one of them.')
        print(name)
        namespace, _, own = name.rpartition("/")
        _print_info(node, own, namespace or "/", hidden=args.include_hidden)


def _print_info(node: Node, name: str, namespace: str, *, hidden: bool) -> None:
    from rclpy.action import get_action_client_names_and_types_by_node, get_action_server_names_and_types_by_node

    from ..graph import visible

    parts = {
        "Subscribers": node.get_subscriber_names_and_types_by_node(name, namespace),
        "Publishers": node.get_publisher_names_and_types_by_node(name, namespace),
        "Service Servers": node.get_service_names_and_types_by_node(name, namespace),
        "Service Clients": node.get_client_names_and_types_by_node(name, namespace),
        "Action Servers": get_action_server_names_and_types_by_node(node, name, namespace),
        "Action Clients": get_action_client_names_and_types_by_node(node, name, namespace),
    }
    for title, found in parts.items():
        print(f"  {title}:")
        print("\n".join(f"    {one}: {', '.join(types)}" for one, types in visible(found, hidden=hidden).items()))


def add(words: Verbs) -> None:
    """Add the command `ros2 node` and its verbs to `words`, the subcommands of the `ros2` parser."""
    verbs = group(words, "node", "look at nodes")
    one = verb(verbs, "list", show_list, "name the nodes")
    one.add_argument("-a", "--all", action="store_true", help="those that begin with _, too")
    one.add_argument("-c", "--count-nodes", action="store_true", help="print how many there are")
    add_discovery(one)
    one = verb(verbs, "info", info, "print topics and services of a node")
    add_node(one)
    one.add_argument("--include-hidden", action="store_true", help="names that begin with _, too")
    add_discovery(one)
