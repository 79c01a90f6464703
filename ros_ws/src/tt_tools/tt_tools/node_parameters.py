"""Collects the parameters of all nodes of a graph, each once, without waiting for answers."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import yaml
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden

SERVICE = "/list_parameters"


def parameter_file(node: str, names: list[str], values: list[ParameterValue]) -> str:
    """Return parameters as the text of a parameter file.

    Args:
        node: Full name of the node.
        names: Of the parameters.
        values: Of the parameters.
    """
    content: dict[str, Any] = {}
    for name, value in sorted(zip(names, map(parameter_value_to_python, values), strict=True), key=lambda row: row[0]):
        inner, rest = content, name
        while "." in rest and isinstance(inner.get(group := rest.partition(".")[0], {}), dict):
            inner, rest = inner.setdefault(group, {}), rest.partition(".")[2]
        # where a group has the name of a parameter, as `right` and `right.matrix`, the dot stays
        inner[rest] = value.tolist() if hasattr(value, "tolist") else list(value) if isinstance(value, (list, bytes)) else value
    return str(yaml.safe_dump({node: {"ros__parameters": content}}, default_flow_style=False))


class ParameterCollector:
    """Asks each node for its parameters when it is discovered."""

    def __init__(self, node: Node, take: Callable[[str, dict[str, Any], str], None]) -> None:
        """Begin.

        Args:
            node: Asks; its executor runs the answers.
            take: Takes the full name of a node, its parameters by name, and the text of their parameter file.
        """
        self._node, self._take = node, take
        self._waiting: dict[str, tuple[Any, Any]] = {}  # clients of those that were not asked yet, by the names of the nodes
        self._seen: set[str] = set()

    def look(self) -> None:
        """Find new nodes, and ask those that are ready."""
        for name, _ in self._node.get_service_names_and_types():
            owner = name.removesuffix(SERVICE)
            if owner != name and owner not in self._seen and not topic_or_service_is_hidden(owner):
                self._seen.add(owner)
                create = self._node.create_client
                self._waiting[owner] = create(ListParameters, name), create(GetParameters, f"{owner}/get_parameters")
        for owner, clients in list(self._waiting.items()):
            if all(client.service_is_ready() for client in clients):
                del self._waiting[owner]
                listed = clients[0].call_async(ListParameters.Request())
                listed.add_done_callback(partial(self._on_names, owner, clients[1]))

    def _on_names(self, owner: str, client: Any, answer: Any) -> None:
        if answer.result() is not None:
            names = sorted(answer.result().result.names)
            client.call_async(GetParameters.Request(names=names)).add_done_callback(partial(self._on_values, owner, names))

    def _on_values(self, owner: str, names: list[str], answer: Any) -> None:
        if answer.result() is not None and len(answer.result().values) == len(names):
            values = list(answer.result().values)
            content = dict(zip(names, map(parameter_value_to_python, values), strict=True))
            self._take(owner, content, parameter_file(owner, names, values))
