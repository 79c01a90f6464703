"""Run the functions of the nodes on a recording, as fast as possible, and write a new recording.

The new results replace those in the recording; all other messages are copied. The same recording and parameters give the same bytes each
time. If the recording has joint states and no /tf, the transforms are computed from them and from the URDF.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml
from ament_index_python.packages import get_package_share_directory
from rclpy.serialization import serialize_message
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from scipy.spatial.transform import Rotation
from tt_arm.arm_file import InstalledArm
from tt_arm.description import placed_description
from tt_arm.model import base_placement
from tt_core.errors import TtError
from tt_core.params import params_from_values
from tt_core.robots import read_arm
from tt_core.ros.bags import TYPESTORE, Bag, Message
from tt_tools.bagfile import BagFile
from tt_tools.describe import attachments
from tt_vision.estimate_node import read_poses
from tt_vision.rig import SIDES

from .frames import RobotFrames, Transform
from .stages import STAGES, StageChain

TF = "tf2_msgs/msg/TFMessage"
FOREVER = QosTime(9223372036, 854775807)
URDF = "robot_arm_urdf.urdf"
REPROCESSED_NODES = ("estimate", "predict", "racket", "arm")


def offered(*, latched: bool = False) -> Qos:
    """Return the quality of service that is recorded for a topic which is made here. latched: transient local instead of volatile."""
    durability = QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE
    return Qos(QosHistory.KEEP_LAST, 100, QosReliability.RELIABLE, durability, FOREVER, FOREVER, QosLiveliness.AUTOMATIC, FOREVER, False)


def flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield name and value of each parameter of nested mappings, with the names of the groups before it, e.g. "swing.command_timeout".

    Args:
        values: Nested mappings, as in a parameter file.
        prefix: Text before each name.
    """
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def node_parameters(text: str) -> dict[str, dict[str, Any]]:
    """Read the text of a parameter file.

    Returns:
        For each node, by its name without a namespace, the parameter values by name.

    Raises:
        TtError: The text is no parameter file.
    """
    try:
        content = yaml.safe_load(text) or {}
        return {node.rpartition("/")[2]: dict(flat(entry["ros__parameters"])) for node, entry in content.items()}
    except (yaml.YAMLError, KeyError, TypeError, AttributeError) as error:
        raise TtError(f"no parameter file: {' '.join(str(error).split())}") from error


def all_parameters(attached: Mapping[str, bytes], files: Sequence[Path]) -> dict[str, dict[str, Any]]:
    """Return the parameter values of all nodes, from config/parameters.yaml, from a recording and from parameter files.

    Args:
        attached: Attachments of the recording. Parameters among them override those of config/parameters.yaml.
        files: Parameter files. They override both, and a later file overrides an earlier one.

    Returns:
        For each node, by its name without a namespace, the values by name.

    Raises:
        TtError: A file cannot be read, or is no parameter file.
    """
    texts = [(Path(get_package_share_directory("tt_bringup")) / "config" / "parameters.yaml").read_text()]
    texts += [data.decode() for name, data in attached.items() if name.startswith("parameters/")]
    for file in files:
        try:
            texts.append(file.read_text())
        except (OSError, UnicodeDecodeError) as error:
            raise TtError(f"{file} cannot be read: {error}") from error
    found: dict[str, dict[str, Any]] = {node: {} for node in REPROCESSED_NODES}
    for text in texts:
        for node, values in node_parameters(text).items():
            found.setdefault(node, {}).update(values)
    return found


def recorded_description(urdf: str | None, values: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the robot description (URDF) of a recorded arm, with its base placed in the frame `table`.

    Args:
        urdf: The recorded URDF; None to make the URDF of the arm that the parameters name.
        values: Parameter values by name, for each node.

    Raises:
        TtError: The arm that the parameters name cannot be read, or `urdf` is no URDF.
    """
    params = params_from_values(InstalledArm, values["arm"])
    if urdf is None:
        return params.model().placed_description
    return placed_description(urdf, base_placement(params.base or read_arm(params.robot)[0].base))


def packed(kind: str, message: Any) -> bytes:
    """Serialize a message to CDR, with padding bytes that are always 0.

    Args:
        kind: Message type, e.g. "nav_msgs/msg/Odometry".
        message: A message of rclpy or of rosbags.
    """
    if not hasattr(message, "get_fields_and_field_types"):
        return bytes(TYPESTORE.serialize_cdr(message, kind))
    return bytes(TYPESTORE.serialize_cdr(TYPESTORE.deserialize_cdr(serialize_message(message), kind), kind))


class TransformMessages:
    """Makes the messages of /tf and /tf_static: the frames of the arm, and those of the high-speed cameras."""

    def __init__(self, urdf: str | None, values: Mapping[str, Mapping[str, Any]]) -> None:
        """Read the arm, its place, and the poses of the cameras.

        Args:
            urdf: The recorded URDF; None to make the URDF of the arm that the parameters name.
            values: Parameter values by name, for each node.

        Raises:
            TtError: The URDF or a parameter cannot be used.
        """
        self._frames = RobotFrames(recorded_description(urdf, values))
        cameras = read_poses(lambda kind, prefix="": params_from_values(kind, values["estimate"], prefix))
        self._fixed = list(self._frames.fixed)
        for name, camera in zip(SIDES, cameras, strict=True):
            back = camera.rotation.T
            self._fixed.append(Transform("table", f"{name}_optical", back, -back @ camera.translation))

    def static(self, at: int) -> Any:
        """Return the message of /tf_static with the transforms that never change. at: its stamp, ns."""
        stamp = TYPESTORE.types["builtin_interfaces/msg/Time"](at // 10**9, at % 10**9)
        return self._message(stamp, self._fixed)

    def moving(self, joints: Any) -> Any:
        """Return the message of /tf with the transforms of the moving joints. joints: a sensor_msgs/JointState message."""
        return self._message(joints.header.stamp, self._frames.at(dict(zip(joints.name, joints.position, strict=False))))

    @staticmethod
    def _message(stamp: Any, transforms: Sequence[Transform]) -> Any:
        make = {name: TYPESTORE.types[f"geometry_msgs/msg/{name}"] for name in ("TransformStamped", "Transform", "Vector3", "Quaternion")}
        rows = [
            make["TransformStamped"](
                TYPESTORE.types["std_msgs/msg/Header"](stamp, one.parent),
                one.child,
                make["Transform"](
                    make["Vector3"](*one.translation.tolist()), make["Quaternion"](*Rotation.from_matrix(one.rotation).as_quat().tolist())
                ),
            )
            for one in transforms
        ]
        return TYPESTORE.types[TF](rows)


class RecordingWriter:
    """Writer of the new recording."""

    def __init__(self, path: Path) -> None:
        """Make the bag. path: its directory, which must not exist yet. Raises BagError if it exists or cannot be made."""
        self._bag = BagFile(path, reserve=0)

    def add(self, topic: str, kind: str, time: int, data: bytes, qos: Sequence[Qos]) -> None:
        """Write a message, and add its topic to the bag if it is the first one.

        Args:
            topic: Full name of the topic.
            kind: Message type, e.g. "nav_msgs/msg/Odometry".
            time: Time at which it was received, ns.
            data: The serialized message (CDR).
            qos: Quality of service of the topic's publishers.

        Raises:
            OSError: The disk has no room, or failed.
        """
        if topic not in self._bag.counts:
            self._bag.add_topic(topic, kind, qos)
        self._bag.make_room(len(data), time)
        self._bag.write(topic, time, data)

    def close(self, attached: Mapping[str, bytes], at: int) -> str:
        """Add attachments and close the bag.

        Args:
            attached: Content of each attachment by name.
            at: Time that is stored with the attachments, ns.

        Returns:
            Text about what was written.
        """
        for name, data in sorted(attached.items()):
            self._bag.attach(name, at, "application/octet-stream", data)
        return str(self._bag.close())


def reprocess(path: Path, first: str, output: Path, files: Sequence[Path] = ()) -> str:
    """Run a stage (the function of one node) and all later ones on a recording, and write a new recording.

    Args:
        path: The recording, a bag of any kind.
        first: Name of the first stage, one of stages.STAGES.
        output: Directory of the new bag, which must not exist yet.
        files: Parameter files that override the recorded parameters; see `all_parameters`.

    Returns:
        Text for people about what was made, refused and written.

    Raises:
        TtError: The bag or a parameter file cannot be read, or the new bag cannot be written.
    """
    attached = attachments(path)
    values = all_parameters(attached, files)
    chain = StageChain(first, values)
    transforms = TransformMessages(attached[URDF].decode() if URDF in attached else None, values)
    begin = time.monotonic()
    with Bag(path) as bag:
        names = {full: name for name in (*chain.inputs, *chain.outputs, "joint_states") if (full := bag.find(name))}
        if not any(names[full] in chain.inputs - {"return/goal"} for full in names):
            raise TtError(f"{path} has none of {', '.join(sorted(chain.inputs))}, which {first} needs")
        result = RecordingWriter(output)
        try:
            _run(bag, names, chain, transforms, result)
            written = result.close(attached, bag.start)
        except OSError as error:
            raise TtError(f"{output} cannot be written: {error}") from error
        speed = (bag.end - bag.start) * 1e-9 / (time.monotonic() - begin)
    counts = ", ".join(f"{count} on {topic}" for topic, count in sorted(chain.made.items())) or "nothing"
    refused = "".join(f"; refused {count}: {reason}" for reason, count in sorted(chain.refused.items()))
    return f"made {counts}{refused}\nwrote {written}; {speed:.1f} times as fast as recorded"


def _run(bag: Bag, names: Mapping[str, str], chain: StageChain, transforms: TransformMessages, result: RecordingWriter) -> None:
    recorded = {topic.name: topic.offered for topic in bag.topics}
    with_tf = "/tf" not in recorded and "joint_states" in names.values()
    if with_tf and "/tf_static" not in recorded:
        result.add("/tf_static", TF, bag.start, packed(TF, transforms.static(bag.start)), [offered(latched=True)])
    for message in bag.messages():
        name = names.get(message.topic, "")
        if name not in chain.outputs:
            result.add(message.topic, message.kind, message.time, message.data, recorded[message.topic])
        if with_tf and name == "joint_states":
            result.add("/tf", TF, message.time, packed(TF, transforms.moving(bag.decode(message))), [offered()])
        if name in chain.inputs:
            _take(bag, message, name, chain, result)


def _take(bag: Bag, message: Message, name: str, chain: StageChain, result: RecordingWriter) -> None:
    namespace = message.topic.removesuffix(name)
    for output in chain.take(name, bag.decode(message)):
        result.add(f"{namespace}{output.topic}", output.kind, message.time, packed(output.kind, output.message), [offered()])


def main() -> int:
    """Run the command `ros2 run tt_bringup reprocess` and return its exit code."""
    parser = argparse.ArgumentParser(prog="reprocess", description=__doc__)
    parser.add_argument("bag", type=Path, help="recording of any kind")
    parser.add_argument("--from", dest="first", choices=tuple(STAGES), default="vision", help="first stage that is run anew (vision)")
    parser.add_argument("-o", "--output", type=Path, help="new directory; the name of the recording with _FROM unless given")
    parser.add_argument("--params-file", type=Path, action="append", default=[], help="wins over the parameters in the recording")
    args = parser.parse_args()
    output = args.output or args.bag.absolute().with_name(f"{args.bag.absolute().stem}_{args.first}")
    try:
        print(reprocess(args.bag, args.first, output, args.params_file))
    except TtError as error:
        print(f"reprocess: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0
