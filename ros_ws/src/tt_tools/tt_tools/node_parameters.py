"""Collect the parameters of all nodes of the graph. Each node is asked once, and callbacks take the answers, so that nothing waits."""

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

LIST_SERVICE = "/list_parameters"


def parameter_file_text(node: str, names: list[str], values: list[ParameterValue]) -> str:
    """Return the parameters of a node as the text of a parameter file (YAML).

    Args:
        node: Full name of the node, e.g. /arm.
        names: Names of the parameters. Dots in a name separate groups, which become nested mappings.
        values: Values of the parameters, in the order of `names`.
    """
    content: dict[str, Any] = {}
    for name, value in sorted(zip(names, map(parameter_value_to_python, values), strict=True), key=lambda row: row[0]):
        inner, rest = content, name
        while "." in rest and isinstance(inner.get(group := rest.partition(".")[0], {}), dict):
            inner, rest = inner.setdefault(group, {}), rest.partition(".")[2]
        # if a parameter has the name of a group, as `right` beside `right.matrix`, the name with the dot is kept as one key
        inner[rest] = value.tolist() if hasattr(value, "tolist") else list(value) if isinstance(value, (list, bytes)) else value
    return str(yaml.safe_dump({node: {"ros__parameters": content}}, default_flow_style=False))


class ParameterCollector:
    """Asks each node of the graph for its parameters once, when the node has been discovered."""

    def __init__(self, node: Node, take: Callable[[str, dict[str, Any], str], None]) -> None:
        """Keep the node and the callback. Requests are sent by `check`.

        Args:
            node: Node that sends the requests. Its executor runs the callbacks of the answers.
            take: Called once for each node that has answered, with the full name of the node, its parameter values by name, and the text of
                its parameter file.
        """
        self._node, self._take = node, take
        self._waiting: dict[str, tuple[Any, Any]] = {}  # service clients of the nodes that were not asked yet, by node name
        self._seen: set[str] = set()

    def check(self) -> None:
        """Find new nodes, and send requests to those whose parameter services are ready. To be called periodically."""
        for name, _ in self._node.get_service_names_and_types():
            owner = name.removesuffix(LIST_SERVICE)
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
            self._take(owner, content, parameter_file_text(owner, names, values))
