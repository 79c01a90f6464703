"""List, get, describe, set, dump and load the parameters of running nodes. What is printed is worded as in ros2cli."""

from __future__ import annotations

import itertools
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import yaml
from rcl_interfaces.msg import ParameterDescriptor, ParameterType, ParameterValue
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_dict_from_yaml_file, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future
from tt_core.errors import TtError

from .errors import GraphError
from .graph import appears, graph, nodes, services
from .node_parameters import parameter_file_text

NODE_ANSWER_TIMEOUT = 10.0  # s, longest wait for a node to be discovered, and for each of its answers
AGAIN = 3.0  # s without an answer after which a request is sent again
TYPE_NAMES = {  # what ros2cli prints for each type: in a description, and before a value
    ParameterType.PARAMETER_NOT_SET: ("not set", "Parameter not set."),
    ParameterType.PARAMETER_BOOL: ("boolean", "Boolean value is:"),
    ParameterType.PARAMETER_INTEGER: ("integer", "Integer value is:"),
    ParameterType.PARAMETER_DOUBLE: ("double", "Double value is:"),
    ParameterType.PARAMETER_STRING: ("string", "String value is:"),
    ParameterType.PARAMETER_BYTE_ARRAY: ("byte array", "Byte values are:"),
    ParameterType.PARAMETER_BOOL_ARRAY: ("boolean array", "Boolean values are:"),
    ParameterType.PARAMETER_INTEGER_ARRAY: ("integer array", "Integer values are:"),
    ParameterType.PARAMETER_DOUBLE_ARRAY: ("double array", "Double values are:"),
    ParameterType.PARAMETER_STRING_ARRAY: ("string array", "String values are:"),
}


class ParameterClient:
    """Client that reads and sets the parameters of one running node."""

    def __init__(self, node: Node, name: str, patience: float = NODE_ANSWER_TIMEOUT) -> None:
        """Connect to the parameter services of a node.

        Args:
            node: Node that sends the requests. Its executor is spun while an answer is awaited.
            name: Name of the node whose parameters are meant, e.g. /arm.
            patience: Longest wait for its services, and for each answer, s.

        Raises:
            TtError: Its services do not appear in time.
        """
        self._node, self.name, self._patience = node, "/" + name.lstrip("/"), patience
        self._client = AsyncParameterClient(node, self.name)
        if not self._client.wait_for_services(patience):
            raise TtError(f"no node {self.name} with parameters")

    def names(self) -> list[str]:
        """Return the names of all parameters, sorted. Raises TtError if the node does not answer."""
        return sorted(self._ask(self._client.list_parameters).result.names)

    def values(self, names: list[str]) -> list[ParameterValue]:
        """Return the values of the parameters `names`, in order. Raises TtError if one is not declared or the node does not answer."""
        values = list(self._ask(partial(self._client.get_parameters, names)).values)
        if len(values) != len(names):
            unknown = sorted(set(names) - set(self.names()))
            raise TtError(f"{self.name} has no parameter {', '.join(unknown)}")
        return values

    def descriptors(self, names: list[str]) -> list[ParameterDescriptor]:
        """Return type, description and range of the parameters `names`, in their order.

        Raises TtError if one is not declared or the node does not answer.
        """
        self.values(names)  # refuses undeclared names, which describe_parameters would answer, too
        return list(self._ask(partial(self._client.describe_parameters, names)).descriptors)

    def set(self, parameters: list[Parameter]) -> None:
        """Set parameters one by one.

        Raises:
            TtError: The node refuses a parameter, with its reason, or does not answer. The parameters after it are not set.
        """
        for parameter in parameters:
            (result,) = self._ask(partial(self._client.set_parameters, [parameter])).results
            if not result.successful:
                raise TtError(f"Setting parameter failed: {parameter.name} = {parameter.value}: {result.reason}")

    def _ask(self, question: Callable[[], Future]) -> Any:
        """Return the answer to a request. It is sent again after AGAIN s, because answers can be lost while a connection is being made."""
        assert self._node.executor is not None
        end = time.monotonic() + self._patience
        while (left := end - time.monotonic()) > 0.0:
            future = question()
            self._node.executor.spin_until_future_complete(future, min(AGAIN, left))
            if future.done():
                return future.result()
        raise TtError(f"{self.name} does not answer within {self._patience:g} s")


@contextmanager
def connected(name: str) -> Iterator[ParameterClient]:
    """Yield a client for the parameters of the node `name`. Raises GraphError if there is no such node."""
    full = "/" + name.lstrip("/")
    with graph() as node, _executor(node):
        if not appears(lambda: full in nodes(node, hidden=True)):
            raise GraphError(f"Node not found: {full}; there is {', '.join(nodes(node)) or 'none'}")
        yield ParameterClient(node, full)


@contextmanager
def _executor(node: Node) -> Iterator[None]:
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        yield
    finally:
        executor.shutdown()


def show(node: str, name: str, *, hide_type: bool) -> None:
    """Print the value of the parameter `name` of a node, after its type unless `hide_type`."""
    with connected(node) as client:
        (value,) = client.values([name])
    content = parameter_value_to_python(value)
    text = str(content.tolist() if hasattr(content, "tolist") else content)
    print(text if hide_type else f"{TYPE_NAMES[value.type][1]} {text}".strip() if value.type else TYPE_NAMES[value.type][1])


def print_descriptions(node: str, names: list[str]) -> None:
    """Print type, description and constraints of the parameters `names` of a node."""
    with connected(node) as client:
        for descriptor in client.descriptors(names):
            print(f"Parameter name: {descriptor.name}\n  Type: {TYPE_NAMES[descriptor.type][0]}")
            if descriptor.description:
                print(f"  Description: {descriptor.description}")
            print("  Constraints:")
            if descriptor.read_only:
                print("    Read only: true")
            for bound in (*descriptor.integer_range, *descriptor.floating_point_range):
                print(f"    Min value: {bound.from_value}\n    Max value: {bound.to_value}\n    Step: {bound.step}")
            if descriptor.additional_constraints:
                print(f"    Additional constraints: {descriptor.additional_constraints}")


def dump(node: str) -> str:
    """Return all parameters of a node as the text of a parameter file (YAML), with which the node can be started again."""
    with connected(node) as client:
        names = client.names()
        return parameter_file_text(client.name, names, client.values(names))


def load(node: str, file: Path) -> None:
    """Set the parameters of a parameter file on the running node `node`, and print the name of each.

    Raises:
        TtError: The file cannot be read or has no parameters for the node, or the node is not there or refuses one of them.
    """
    try:
        messages = parameter_dict_from_yaml_file(str(file), use_wildcard=True, target_nodes=["/" + node.lstrip("/")])
    except (OSError, RuntimeError, AttributeError, yaml.YAMLError) as error:
        raise TtError(f"{file} is no parameter file: {error}") from error
    if not messages:
        raise TtError(f"{file} has no parameters for {node}")
    with connected(node) as client:
        for name, message in messages.items():
            client.set([Parameter.from_parameter_msg(message)])
            print(f"Set parameter {name} successful")


def print_names(name: str | None, prefixes: tuple[str, ...], *, hidden: bool, types: bool) -> None:
    """Print the names of the parameters of one node, or of all nodes that have parameters.

    When all nodes are asked, the error of a node that does not answer is printed on stderr, and the others are still printed.

    Args:
        name: Name of the node; None for all nodes.
        prefixes: Only parameters whose names begin with one of these are printed; all if empty.
        hidden: Whether nodes whose names begin with _ are included.
        types: Whether the type of each parameter is printed, too.

    Raises:
        TtError: The node `name` is not there or does not answer.
    """
    with graph() as node, _executor(node):
        full = [f"/{name.lstrip('/')}"] if name else sorted(set(nodes(node, hidden=hidden)))
        if name and not appears(lambda: full[0] in nodes(node, hidden=True)):
            raise GraphError(f"Node not found: {full[0]}; there is {', '.join(nodes(node)) or 'none'}")
        served = services(node, hidden=True)
        for one in full:
            if f"{one}/list_parameters" not in served:
                continue
            client = ParameterClient(node, one)
            try:
                names = [parameter for parameter in client.names() if not prefixes or parameter.startswith(prefixes)]
                kinds = [TYPE_NAMES[descriptor.type][0] for descriptor in client.descriptors(names)] if types and names else []
            except TtError as error:
                if name:
                    raise
                print(error, file=sys.stderr)
                continue
            if not name:
                print(f"{one}:")
            for parameter, kind in itertools.zip_longest(names, kinds):
                print(f"  {parameter} (type: {kind})" if types else f"  {parameter}")


def set_value(node: str, name: str, text: str) -> None:
    """Set the parameter `name` of a node to the value that `text` holds as YAML. Raises TtError if the node is not there or refuses it."""
    with connected(node) as client:
        client.set([Parameter(name, value=yaml.safe_load(text))])
    print("Set parameter successful")
