"""What any ROS tool draws: the graph publishes it in the types, frames and rates that RViz, Foxglove and rqt expect."""

import itertools
import json
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from nav_msgs.msg import Path as Poses
from sensor_msgs.msg import Image, JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectory
from tt_arm.model import ArmModel
from tt_bringup.view.robot_shapes import RobotShapes
from tt_core.ros.convert import path_from_message, seconds
from tt_core.ros.qos import LATCHED, LATEST, RELIABLE, SENSOR
from visualization_msgs.msg import Marker, MarkerArray

CONFIG = Path(__file__).parents[2] / "ros_ws" / "src" / "tt_bringup" / "config"
GRAPH = ("tt_sim.sim_node", "tt_vision.estimate_node", "tt_predict.predict_node", "tt_racket.racket_node", "tt_arm.arm_node")
DRAWN_AS = {  # types that each display of RViz takes
    "MarkerArray": "visualization_msgs/msg/MarkerArray",
    "Path": "nav_msgs/msg/Path",
    "Odometry": "nav_msgs/msg/Odometry",
    "RobotModel": "std_msgs/msg/String",
    "Image": "sensor_msgs/msg/Image",
}
SCENE_TYPES = {"visualization_msgs/msg/MarkerArray", "nav_msgs/msg/Path", "nav_msgs/msg/Odometry"}  # that Foxglove's 3D panel draws


def rviz_topics():
    """Topic, type and whether the subscriber asks for what is transient local, of every display of the RViz configuration."""
    for display in yaml.safe_load((CONFIG / "tabletennis.rviz").read_text())["Visualization Manager"]["Displays"]:
        topic = display.get("Topic") or display.get("Description Topic")
        if topic:
            latched = topic["Durability Policy"] == "Transient Local"
            yield topic["Value"], DRAWN_AS[display["Class"].split("/")[1]], (topic["Reliability Policy"], latched)


def foxglove_topics():
    """Return the topic of each panel of the Foxglove layout, with the message types that the panel can show."""
    for name, panel in json.loads((CONFIG / "foxglove_layout.json").read_text())["configById"].items():
        kind = name.split("!")[0]
        if kind == "3D":
            yield from ((topic, SCENE_TYPES) for topic in panel["topics"])
            yield from ((layer["topic"], {"std_msgs/msg/String"}) for layer in panel["layers"].values())
        elif kind == "Image":
            yield panel["imageMode"]["imageTopic"], {"sensor_msgs/msg/Image"}
            yield panel["imageMode"]["calibrationTopic"], {"sensor_msgs/msg/CameraInfo"}
        elif kind == "Plot":
            yield from ((path["value"].split(".")[0].split("[")[0], None) for path in panel["paths"])
        elif kind == "DiagnosticSummary":
            yield panel["topicToRender"], {"diagnostic_msgs/msg/DiagnosticArray"}


def field_of(path, messages):
    """The value of a plotted path such as /joint_states.velocity[0]."""
    topic, *names = path.split(".")
    value = messages[topic]
    for name in names:
        field, _, index = name.partition("[")
        value = getattr(value, field)
        value = value[int(index.rstrip("]"))] if index else value
    return value


def test_views_are_fed(start, probe, until):
    for module in GRAPH:
        remaps = ("-r", "ball/state:=ball/measured") if "predict" in module else ()
        start(module, "--ros-args", *remaps, *(("-p", "shots:=['top 4']") if "sim" in module else ()))
    start("tt_bringup.marker_node")
    got = {name: [] for name in ("robot", "markers", "poses", "path", "joints", "diagnostics", "balls", "images")}
    keep = {name: messages.append for name, messages in got.items()}
    probe.create_subscription(DiagnosticArray, "/diagnostics", keep["diagnostics"], RELIABLE)
    probe.create_subscription(MarkerArray, "/markers", keep["markers"], RELIABLE)
    probe.create_subscription(Poses, "/ball/path_poses", keep["poses"], RELIABLE)
    probe.create_subscription(MultiDOFJointTrajectory, "/ball/path", keep["path"], RELIABLE)
    probe.create_subscription(Odometry, "/ball/measured", keep["balls"], RELIABLE)
    probe.create_subscription(Image, "/camera/left/image_raw", keep["images"], SENSOR)
    launcher = probe.create_client(Trigger, "/launcher/launch")
    until(lambda: launcher.service_is_ready() and probe.count_subscribers("/ball/path") == 3, probe)
    until(lambda: probe.count_subscribers("/ball/measured") == 3 and probe.count_subscribers("/racket/strokes") == 2, probe)

    # late subscribers receive the description; the joint states are those of its joints, with the torques that hold the arm
    probe.create_subscription(String, "/robot_description", keep["robot"], LATCHED)
    probe.create_subscription(JointState, "/joint_states", keep["joints"], LATEST)
    until(lambda: got["robot"] and got["joints"] and got["markers"], probe)
    shapes, joints, model = RobotShapes(got["robot"][0].data), got["joints"][0], ArmModel.pa10()
    assert list(shapes.speed_limits) == list(joints.name) == list(model.names)
    assert 10.0 < np.abs(joints.effort).max() < model.torque_limits.max()  # N m; at rest the arm holds its weight of 35 kg

    launcher.call_async(Trigger.Request())
    until(lambda: got["poses"] and got["path"] and drawn(got["markers"]) >= {"path", "strokes", "estimated_ball", "arm", "table"}, probe)
    check_path(got)
    check_markers(got["markers"])
    until(lambda: "estimated_ball" not in drawn(got["markers"]), probe)  # it is deleted when its path has ended
    check_configurations(probe, got)
    check_diagnostics(probe, until, got["diagnostics"])


def shown(messages):
    """The markers that a viewer shows after these messages, by their namespace."""
    found = {}
    for marker in itertools.chain.from_iterable(message.markers for message in messages):
        if marker.action == Marker.DELETE:
            found.pop(marker.ns, None)
        else:
            found[marker.ns] = marker
    return found


def drawn(messages):
    return {name.split("/")[0] for name in shown(messages)}


def check_path(got):
    path, poses = path_from_message(got["path"][0]), got["poses"][0]
    places = [[p.pose.position.x, p.pose.position.y, p.pose.position.z] for p in poses.poses]
    assert poses.header.frame_id == "table" and places == pytest.approx(path.positions)
    assert [seconds(p.header.stamp) for p in poses.poses] == pytest.approx(path.times, abs=1e-6)


def check_markers(messages):
    markers = shown(messages)
    assert all(m.header.frame_id == "table" and seconds(m.lifetime) > 0.0 for m in markers.values())
    assert -1.8 < markers["arm/racket/0"].pose.position.x < 0.6  # m; waiting or swinging, it is within reach of its base
    assert markers["table/top"].scale.x == pytest.approx(2.74)
    assert len(markers["path/ahead"].points) > 5


def check_configurations(probe, got):
    published = {name: kinds for name, kinds in probe.get_topic_names_and_types() if probe.count_publishers(name)}
    for topic, kind, (reliability, latched) in rviz_topics():
        assert published.get(topic) == [kind], topic
        for info in probe.get_publishers_info_by_topic(topic):  # DDS connects no subscriber that asks for more than is offered
            assert reliability == "Best Effort" or info.qos_profile.reliability.name == "RELIABLE", topic
            assert not latched or info.qos_profile.durability.name == "TRANSIENT_LOCAL", topic
    layout = list(foxglove_topics())
    assert len(layout) > 10
    for topic, kinds in layout:
        assert topic in published and (kinds is None or set(published[topic]) <= kinds), topic
    messages = {"/joint_states": got["joints"][0], "/ball/measured": got["balls"][0]}
    for panel in json.loads((CONFIG / "foxglove_layout.json").read_text())["configById"].values():
        for path in panel.get("paths", ()):
            assert isinstance(field_of(path["value"], messages), float)
    scene = json.loads((CONFIG / "foxglove_layout.json").read_text())["configById"]["3D!scene"]
    rviz = yaml.safe_load((CONFIG / "tabletennis.rviz").read_text())["Visualization Manager"]["Global Options"]["Fixed Frame"]
    frames = {m.header.frame_id for m in (*shown(got["markers"]).values(), *got["poses"], *got["balls"])}
    assert frames == {scene["followTf"]} == {rviz}


def check_diagnostics(probe, until, arrays):
    """Every node tells once a second that it lives, for what hardware, although nothing happens to it."""
    nodes = {"sim", "estimate", "predict", "racket", "arm", "markers"}
    arrays.clear()
    times, end = {}, time.monotonic() + 3.5
    until(lambda: time.monotonic() > end, probe)
    for message in arrays:
        for status in message.status:
            assert status.hardware_id
            times.setdefault(status.name, []).append(seconds(message.header.stamp))
    assert nodes <= times.keys()
    for name in nodes:
        assert max(np.diff(times[name])) < 1.5, name  # s; a timer on a busy machine
    hardware = {status.name: status.hardware_id for message in arrays for status in message.status}
    assert hardware["arm"] == "pa10" and hardware["sim"] == "simulator"
