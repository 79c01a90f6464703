"""Parameters of running nodes: list, get, describe, set, dump and load them, with the words of ros2cli."""

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
from .node_parameters import parameter_file

PATIENCE = 10.0  # s, for a node to be discovered, and to answer
AGAIN = 3.0  # s after which a question is asked again
TYPES = {  # as ros2cli names them: in a description, and before a value
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
    """The parameters of one running node."""

    def __init__(self, node: Node, name: str, patience: float = PATIENCE) -> None:
        """Connect to a node.

        Args:
            node: Asks the questions; its executor is spun while they are answered.
            name: Of the node asked, e.g. /arm.
            patience: s, for it to be there and for each answer.

        Raises:
            TtError: It is not there in time.
        """
        self._node, self.name, self._patience = node, "/" + name.lstrip("/"), patience
        self._client = AsyncParameterClient(node, self.name)
        if not self._client.wait_for_services(patience):
            raise TtError(f"no node {self.name} with parameters")

    def names(self) -> list[str]:
        """Return the names of all parameters, sorted. Raises TtError without an answer."""
        return sorted(self._ask(self._client.list_parameters).result.names)

    def values(self, names: list[str]) -> list[ParameterValue]:
        """Return the values of `names`. Raises TtError for a name that is not declared, or without an answer."""
        values = list(self._ask(partial(self._client.get_parameters, names)).values)
        if len(values) != len(names):
            unknown = sorted(set(names) - set(self.names()))
            raise TtError(f"{self.name} has no parameter {', '.join(unknown)}")
        return values

    def descriptors(self, names: list[str]) -> list[ParameterDescriptor]:
        """Return what the node tells about `names`. Raises TtError for a name that is not declared, or without an answer."""
        self.values(names)  # a description is also given of what is not declared
        return list(self._ask(partial(self._client.describe_parameters, names)).descriptors)

    def set(self, parameters: list[Parameter]) -> None:
        """Set parameters one by one. Raises TtError with the reason for the first that is refused, or without an answer."""
        for parameter in parameters:
            (result,) = self._ask(partial(self._client.set_parameters, [parameter])).results
            if not result.successful:
                raise TtError(f"Setting parameter failed: {parameter.name} = {parameter.value}: {result.reason}")

    def _ask(self, question: Callable[[], Future]) -> Any:
        """Return the answer to a question, which is asked again after AGAIN: an answer is lost while a connection is being made."""
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
    """Yield a client of the node `name`. Raises GraphError if the node is not there."""
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
    """Print the value of one parameter."""
    with connected(node) as client:
        (value,) = client.values([name])
    content = parameter_value_to_python(value)
    text = str(content.tolist() if hasattr(content, "tolist") else content)
    print(text if hide_type else f"{TYPES[value.type][1]} {text}".strip() if value.type else TYPES[value.type][1])


def describe(node: str, names: list[str]) -> None:
    """Print type, description and constraints of parameters."""
    with connected(node) as client:
        for descriptor in client.descriptors(names):
            print(f"Parameter name: {descriptor.name}\n  Type: {TYPES[descriptor.type][0]}")
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
    """Return all parameters of a node as the text of a parameter file, which can start the node again."""
    with connected(node) as client:
        names = client.names()
        return parameter_file(client.name, names, client.values(names))


def load(node: str, file: Path) -> None:
    """Set the parameters of a file on a running node.

    Raises:
        TtError: The file cannot be read or has none for the node, or the node refuses one.
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
    """Print the parameters of one node, or of all that have some.

    Args:
        name: Of the node; all if None.
        prefixes: Only parameters that begin with one of them; all if empty.
        hidden: Whether nodes are asked whose names begin with _.
        types: Whether types are printed, too.

    Raises:
        TtError: The node is not there, or does not answer. Of all nodes, one that does not answer is told on stderr.
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
                kinds = [TYPES[descriptor.type][0] for descriptor in client.descriptors(names)] if types and names else []
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
    """Set one parameter to a value in YAML. Raises TtError if the node refuses it."""
    with connected(node) as client:
        client.set([Parameter(name, value=yaml.safe_load(text))])
    print("Set parameter successful")
