"""Run the functions of the nodes over a recording, as fast as they go, and write a new recording.

The results replace those in the recording; all else is copied. The same recording and parameters give the same bytes each time. Where the
recording has joint states and no /tf, transforms are made from them and from the URDF.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml
from ament_index_python.packages import get_package_share_directory
from mcap.reader import make_reader
from rclpy.serialization import serialize_message
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from scipy.spatial.transform import Rotation
from tt_arm.arm_file import InstalledArm
from tt_arm.description import placed_description
from tt_arm.model import base_placement
from tt_core.errors import TtError
from tt_core.params import from_values
from tt_core.robots import read_arm
from tt_core.ros.bags import TYPES, Bag, Message, bag_files
from tt_tools.bagfile import BagFile
from tt_vision.estimate_node import read_poses
from tt_vision.rig import SIDES

from .frames import Frames, Transform
from .stages import STAGES, Chain

TF = "tf2_msgs/msg/TFMessage"
FOREVER = QosTime(9223372036, 854775807)
URDF = "robot_arm_urdf.urdf"
NODES = ("estimate", "predict", "racket", "arm")


def offered(*, latched: bool = False) -> Qos:
    """Return the quality of service of a topic that is made here."""
    durability = QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE
    return Qos(QosHistory.KEEP_LAST, 100, QosReliability.RELIABLE, durability, FOREVER, FOREVER, QosLiveliness.AUTOMATIC, FOREVER, False)


def flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the parameters of nested mappings by their full names."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def parameters(text: str) -> dict[str, dict[str, Any]]:
    """Return the parameters by name, by the last part of the name of the node, of the text of a parameter file. Raises TtError."""
    try:
        content = yaml.safe_load(text) or {}
        return {node.rpartition("/")[2]: dict(flat(entry["ros__parameters"])) for node, entry in content.items()}
    except (yaml.YAMLError, KeyError, TypeError, AttributeError) as error:
        raise TtError(f"no parameter file: {' '.join(str(error).split())}") from error


def attachments(path: Path) -> dict[str, bytes]:
    """Return the attachments of a bag by name; none of a bag that is not MCAP."""
    found: dict[str, bytes] = {}
    for file in bag_files(path):
        if file.suffix == ".mcap":
            with file.open("rb") as stream, suppress(Exception):  # a file without an index has no attachments
                found |= {attachment.name: attachment.data for attachment in make_reader(stream).iter_attachments()}
    return found


def all_parameters(attached: Mapping[str, bytes], files: Sequence[Path]) -> dict[str, dict[str, Any]]:
    """Return the parameters of the nodes.

    Args:
        attached: Attachments of the bag; parameters among them win over config/parameters.yaml.
        files: Parameter files, which win over both, the last one most.

    Raises:
        TtError: A file is none, or cannot be read.
    """
    texts = [(Path(get_package_share_directory("tt_bringup")) / "config" / "parameters.yaml").read_text()]
    texts += [data.decode() for name, data in attached.items() if name.startswith("parameters/")]
    for file in files:
        try:
            texts.append(file.read_text())
        except (OSError, UnicodeDecodeError) as error:
            raise TtError(f"{file} cannot be read: {error}") from error
    found: dict[str, dict[str, Any]] = {node: {} for node in NODES}
    for text in texts:
        for node, values in parameters(text).items():
            found.setdefault(node, {}).update(values)
    return found


def recorded_description(urdf: str | None, values: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the description of a recorded arm in `table`.

    Args:
        urdf: The recorded one; None to make that of the parameters.
        values: Parameters of the nodes.

    Raises:
        TtError: The arm of the parameters cannot be read, or `urdf` is no URDF.
    """
    params = from_values(InstalledArm, values["arm"])
    if urdf is None:
        return params.model().placed_description
    return placed_description(urdf, base_placement(params.base or read_arm(params.robot)[0].base))


def packed(kind: str, message: Any) -> bytes:
    """Return the CDR of a message of ROS or rosbags; its padding is always 0."""
    if not hasattr(message, "get_fields_and_field_types"):
        return bytes(TYPES.serialize_cdr(message, kind))
    return bytes(TYPES.serialize_cdr(TYPES.deserialize_cdr(serialize_message(message), kind), kind))


class TransformMessages:
    """Makes /tf and /tf_static."""

    def __init__(self, urdf: str | None, values: Mapping[str, Mapping[str, Any]]) -> None:
        """Read the arm and the poses of arm and cameras; urdf: None for that of the parameters. Raises TtError."""
        self._frames = Frames(recorded_description(urdf, values))
        cameras = read_poses(lambda kind, prefix="": from_values(kind, values["estimate"], prefix))
        self._fixed = list(self._frames.fixed)
        for name, camera in zip(SIDES, cameras, strict=True):
            back = camera.rotation.T
            self._fixed.append(Transform("table", f"{name}_optical", back, -back @ camera.translation))

    def static(self, at: int) -> Any:
        """Return the message of the transforms that never change. at: ns."""
        stamp = TYPES.types["builtin_interfaces/msg/Time"](at // 10**9, at % 10**9)
        return self._message(stamp, self._fixed)

    def moving(self, joints: Any) -> Any:
        """Return the message of the transforms at joint states, a sensor_msgs/JointState."""
        return self._message(joints.header.stamp, self._frames.at(dict(zip(joints.name, joints.position, strict=False))))

    @staticmethod
    def _message(stamp: Any, transforms: Sequence[Transform]) -> Any:
        make = {name: TYPES.types[f"geometry_msgs/msg/{name}"] for name in ("TransformStamped", "Transform", "Vector3", "Quaternion")}
        rows = [
            make["TransformStamped"](
                TYPES.types["std_msgs/msg/Header"](stamp, one.parent),
                one.child,
                make["Transform"](
                    make["Vector3"](*one.translation.tolist()), make["Quaternion"](*Rotation.from_matrix(one.rotation).as_quat().tolist())
                ),
            )
            for one in transforms
        ]
        return TYPES.types[TF](rows)


class Output:
    """The new recording."""

    def __init__(self, path: Path) -> None:
        """Make it. Raises BagError."""
        self._bag = BagFile(path, reserve=0)

    def add(self, topic: str, kind: str, time: int, data: bytes, qos: Sequence[Qos]) -> None:
        """Write a message. Raises OSError if the disk does not take it."""
        if topic not in self._bag.counts:
            self._bag.add_topic(topic, kind, qos)
        self._bag.make_room(len(data), time)
        self._bag.write(topic, time, data)

    def close(self, attached: Mapping[str, bytes], at: int) -> str:
        """Close the bag with attachments of the time `at`, ns; return what was written."""
        for name, data in sorted(attached.items()):
            self._bag.attach(name, at, "application/octet-stream", data)
        return str(self._bag.close())


def reprocess(path: Path, first: str, output: Path, files: Sequence[Path] = ()) -> str:
    """Run the stages from `first` on over a recording.

    Args:
        path: A bag of any kind.
        first: One of STAGES.
        output: The new bag, which must not exist.
        files: Parameter files; see all_parameters.

    Returns:
        What was made, refused and written, for people.

    Raises:
        TtError: The bag or a parameter file cannot be read, or the new bag not be written.
    """
    attached = attachments(path)
    values = all_parameters(attached, files)
    chain = Chain(first, values)
    transforms = TransformMessages(attached[URDF].decode() if URDF in attached else None, values)
    begin = time.monotonic()
    with Bag(path) as bag:
        names = {full: name for name in (*chain.inputs, *chain.outputs, "joint_states") if (full := bag.find(name))}
        if not any(names[full] in chain.inputs - {"return/goal"} for full in names):
            raise TtError(f"{path} has none of {', '.join(sorted(chain.inputs))}, which {first} needs")
        result = Output(output)
        try:
            _run(bag, names, chain, transforms, result)
            written = result.close(attached, bag.start)
        except OSError as error:
            raise TtError(f"{output} cannot be written: {error}") from error
        speed = (bag.end - bag.start) * 1e-9 / (time.monotonic() - begin)
    counts = ", ".join(f"{count} on {topic}" for topic, count in sorted(chain.made.items())) or "nothing"
    refused = "".join(f"; refused {count}: {reason}" for reason, count in sorted(chain.refused.items()))
    return f"made {counts}{refused}\nwrote {written}; {speed:.1f} times as fast as recorded"


def _run(bag: Bag, names: Mapping[str, str], chain: Chain, transforms: TransformMessages, result: Output) -> None:
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


def _take(bag: Bag, message: Message, name: str, chain: Chain, result: Output) -> None:
    namespace = message.topic.removesuffix(name)
    for output in chain.take(name, bag.decode(message)):
        result.add(f"{namespace}{output.topic}", output.kind, message.time, packed(output.kind, output.message), [offered()])


def main() -> int:
    """Run the command line and return the exit code."""
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
