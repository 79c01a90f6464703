"""Write the parameters of all nodes to the files that hold them: python -m tt_bringup.parameters CONFIG.yaml REFERENCE.md.

Names, values, units, meanings and ranges are asked of the running nodes, so the files hold what `ros2 param describe` tells.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import tempfile
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rclpy
import yaml
from domain_coordinator import domain_id
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from tt_core.ros.params import parameter_descriptor
from tt_tools.packages import executable
from tt_tools.parameter_client import ParameterClient
from tt_tools.play_node import BagPlayParams
from tt_tools.record_node import RecordParams
from tt_vision.rig import SIDES

from .view_node import ViewParams

NODE_PROGRAMS = {
    "sim": ("tt_sim", "sim_node"),
    "camera": ("tt_vision", "camera_node"),
    "estimate": ("tt_vision", "estimate_node"),
    "track": ("tt_vision", "track_node"),
    "predict": ("tt_predict", "predict_node"),
    "racket": ("tt_racket", "racket_node"),
    "arm": ("tt_arm", "arm_node"),
    "learn": ("tt_bringup", "learn_node"),
    "markers": ("tt_bringup", "marker_node"),
    "view": ("tt_bringup", "view_node"),
}
# parameters that are NaN in the file, which stands for the value of the physical model, of the world or of the arm file
MODEL_PREFIXES = ("air.", "table.", "racket.", "plant.")
OF_ARM = ("x_low", "x_high", "y_low", "y_high", "z_low", "z_high", "racket_speed", "command_timeout", "swing.command_timeout")
OF_MIDDLEWARE = ("use_sim_time", "start_type_description_service", "qos_overrides.")
NODE_TIMEOUT = 120.0  # s, longest wait for a node to answer: its first start compiles kernels


@dataclass(slots=True)
class Declared:
    """One parameter of one node.

    Attributes:
        name: Name of the parameter.
        value: Its value.
        descriptor: Its description, range and whether it is read-only, as the node declares them.
    """

    name: str
    value: Any
    descriptor: ParameterDescriptor


def ask(node: Node, name: str) -> list[Declared]:
    """Ask a running node for all its parameters except those of the middleware.

    Args:
        node: Node that sends the requests.
        name: Name of the node that is asked.

    Returns:
        The parameters, sorted by name.

    Raises:
        TtError: The node does not answer within NODE_TIMEOUT s.
    """
    client = ParameterClient(node, name, NODE_TIMEOUT)
    names = [n for n in client.names() if not n.startswith(OF_MIDDLEWARE)]
    values = map(parameter_value_to_python, client.values(names))
    return [Declared(*row) for row in zip(names, values, client.descriptors(names), strict=True)]


def as_yaml(nodes: dict[str, list[Declared]]) -> str:
    """Return the text of the parameter file, with meaning and unit of each parameter as a comment. nodes: parameters by node."""
    lines = [
        "# Every parameter of every node, as the launch files load it. Written by: python -m tt_bringup.parameters",
        "# .nan stands for the value of the model that `physics` names, of the world, or of the arm file.",
    ]
    for node, parameters in nodes.items():
        lines += [f"/**/{node}:", "  ros__parameters:"]
        for one in parameters:
            is_default = one.name.startswith(MODEL_PREFIXES) or one.name in OF_ARM
            value = float("nan") if is_default else list(one.value) if hasattr(one.value, "tolist") else one.value
            text = yaml.safe_dump(value, default_flow_style=True, width=1000).removesuffix("\n...\n").strip()
            lines.append(f"    {one.name}: {text}  # {one.descriptor.description}")
    return "\n".join(lines) + "\n"


def bounds(descriptor: ParameterDescriptor) -> str:
    """Return the range or the choices of a parameter as text; "" if it has none."""
    for bound in (*descriptor.floating_point_range, *descriptor.integer_range):
        return f"{bound.from_value:g} to {bound.to_value:g}"
    return descriptor.additional_constraints


def as_markdown(nodes: dict[str, list[Declared]]) -> str:
    """Return the text of the reference, a Markdown table of the parameters of each node. nodes: parameters by node."""
    lines = [
        "# Parameters",
        "",
        "Of all nodes, as `ros2 param describe` tells them. Written by `python -m tt_bringup.parameters`. Parameters that act at run time",
        "are marked; the others are read at the start, and setting them later fails.",
    ]
    for node, parameters in nodes.items():
        lines += ["", f"## {node}", "", "| parameter | default | meaning | range | at run time |", "|---|---|---|---|---|"]
        for one in parameters:
            value = list(one.value) if hasattr(one.value, "tolist") else one.value
            acts = "" if one.descriptor.read_only else "yes"
            lines.append(f"| `{one.name}` | `{value!r}` | {one.descriptor.description} | {bounds(one.descriptor)} | {acts} |")
    return "\n".join(lines) + "\n"


def of_class(kind: type) -> list[Declared]:
    """Return the parameters that a dataclass of `param` fields declares, for nodes that offer no parameter services."""
    return [
        Declared(
            f.name,
            list(f.default) if isinstance(f.default, tuple) else f.default,
            parameter_descriptor(f.metadata, f.default, read_only=True),
        )
        for f in sorted(fields(kind), key=lambda f: f.name)
    ]


def collect() -> dict[str, list[Declared]]:
    """Start all nodes with their default parameters, ask each for its parameters, and end the nodes.

    Returns:
        The parameters of each node, by its name.
    """
    with tempfile.TemporaryDirectory() as folder, domain_id() as domain:
        for side in SIDES:  # the camera node ends without an image
            cv2.imwrite(f"{folder}/{side}_0.000000.png", np.zeros((8, 8), np.uint8))
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        given = {"camera": ["--ros-args", "-p", f"path:={folder}"], "view": ["--ros-args", "-p", "port:=0"]}
        started = [subprocess.Popen([executable(*place), *given.get(name, ())]) for name, place in NODE_PROGRAMS.items()]
        rclpy.init()
        node, executor = rclpy.create_node("parameters"), SingleThreadedExecutor()
        executor.add_node(node)
        try:
            nodes = {name: ask(node, name) for name in NODE_PROGRAMS}
        finally:
            executor.shutdown()
            node.destroy_node()
            rclpy.try_shutdown()
            for process in started:
                process.terminate()
            for process in started:
                process.wait()
    for one in nodes["camera"] + nodes["view"]:
        one.value = {"path": "", "port": ViewParams.port}.get(one.name, one.value)
    return nodes | {"record": of_class(RecordParams), "play": of_class(BagPlayParams)}


def main() -> None:
    """Run the command line: collect the parameters, and write the parameter file and the reference."""
    parser = argparse.ArgumentParser(prog="parameters", description=__doc__)
    parser.add_argument("config", type=Path, help="the parameter file, YAML")
    parser.add_argument("reference", type=Path, help="the table of all parameters, Markdown")
    args = parser.parse_args()
    nodes = collect()
    args.config.write_text(as_yaml(nodes))
    args.reference.write_text(as_markdown(nodes))


if __name__ == "__main__":
    main()
