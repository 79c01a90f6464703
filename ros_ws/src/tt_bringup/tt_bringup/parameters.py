"""Write the parameters of all nodes to the files that hold them: python -m tt_bringup.parameters CONFIG.yaml REFERENCE.md.

Names, values, units, meanings and ranges are read from nodes made for this, so the files hold what `ros2 param describe` tells.
"""

from __future__ import annotations

import argparse
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
from rclpy.node import Node
from tt_arm.arm_node import ArmNode
from tt_core.ros.node_main import join_threads
from tt_core.ros.params import parameter_descriptor
from tt_predict.predict_node import PredictNode
from tt_racket.racket_node import RacketNode
from tt_sim.sim_node import SimNode
from tt_tools.play_node import BagPlayParams
from tt_tools.record_node import RecordParams
from tt_vision.camera_node import CameraNode
from tt_vision.estimate_node import EstimateNode
from tt_vision.rig import SIDES
from tt_vision.track_node import TrackNode

from .learn_node import LearnNode
from .marker_node import MarkerNode
from .view_node import ViewNode, ViewParams

NODES = (SimNode, CameraNode, EstimateNode, TrackNode, PredictNode, RacketNode, ArmNode, LearnNode, MarkerNode, ViewNode)
# parameters that are NaN in the file, which stands for the value of the physical model, of the world or of the arm file
MODEL_PREFIXES = ("air.", "table.", "racket.", "plant.")
OF_ARM = ("x_low", "x_high", "y_low", "y_high", "z_low", "z_high", "racket_speed", "command_timeout", "swing.command_timeout")
OF_MIDDLEWARE = ("use_sim_time", "start_type_description_service", "qos_overrides.")


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


def of_node(node: Node) -> list[Declared]:
    """Return all parameters of a node except those of the middleware, sorted by name."""
    names = sorted(name for name in node.get_parameters_by_prefix("") if not name.startswith(OF_MIDDLEWARE))
    values = (one.value for one in node.get_parameters(names))
    return [Declared(*row) for row in zip(names, values, node.describe_parameters(names), strict=True)]


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
    """Make all nodes with their default parameters in this process, and read their parameters.

    Returns:
        The parameters of each node, by its name.
    """
    made = list[Node]()
    with tempfile.TemporaryDirectory() as folder, domain_id() as domain:
        for side in SIDES:  # the camera node ends without an image
            cv2.imwrite(f"{folder}/{side}_0.000000.png", np.zeros((8, 8), np.uint8))
        rclpy.init(args=["--ros-args", "-p", f"camera:path:={folder}", "-p", "view:port:=0"], domain_id=domain)
        try:
            for make in NODES:
                made.append(make())
            nodes = {node.get_name(): of_node(node) for node in made}
        finally:
            for node in made:
                getattr(node, "close", lambda: None)()
            rclpy.try_shutdown()
            join_threads()
            for node in made:
                node.destroy_node()
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
