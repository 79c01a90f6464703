"""Publish table, arm, ball, predicted path, strokes and landing place as markers, which RViz and Foxglove draw."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from geometry_msgs.msg import Point
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from scipy.spatial.transform import Rotation
from tt_core.params import check, param
from tt_core.priority import Priority
from tt_core.ros.diagnostics import Status
from tt_core.ros.node_main import run
from tt_core.ros.params import declare, declare_physics
from tt_core.ros.qos import RELIABLE
from visualization_msgs.msg import Marker, MarkerArray

from .view.items import Item, Shape
from .view.scene_inputs import SceneInputs

NICE = 5  # priority of the process: the robot comes first
REPEAT_INTERVAL = 1.0  # s after which all markers are published again, changed or not, for viewers that have subscribed later
LIFETIME = 2.5  # s after which a viewer removes a marker that is not published again
MARKER_TYPES = {
    Shape.BOX: Marker.CUBE,
    Shape.CYLINDER: Marker.CYLINDER,
    Shape.ELLIPSOID: Marker.SPHERE,
    Shape.MESH: Marker.MESH_RESOURCE,
    Shape.LINE: Marker.LINE_STRIP,
    Shape.ARROW: Marker.ARROW,
}


@dataclass(frozen=True)
class MarkerParams:
    """Parameters of the node: how often markers are published."""

    rate: float = param(20.0, "1/s", "rate of markers that have changed; all are published once a second", low=1.0, high=60.0)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


class MarkerNode(Node):
    """Node that publishes the scene (table, arm, ball, predicted path, strokes, landing place) as markers on the topic `markers`.

    It publishes only while the topic has subscribers. A marker is deleted when the scene does not show its item any more.
    """

    def __init__(self) -> None:
        """Declare the parameters, then subscribe."""
        super().__init__("markers")
        params = declare(self, MarkerParams)
        self.inputs = SceneInputs(self, declare_physics(self), Status(self), 1.0 / params.rate)
        self.markers = self.create_publisher(MarkerArray, "markers", RELIABLE)
        self.shown: dict[str, Item] = {}
        self.whole_at = -inf  # s, when all markers were published last
        self.create_timer(1.0 / params.rate, self.on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def on_timer(self) -> None:
        """Publish the markers of the items that have changed, and delete those of items that are gone."""
        if not self.markers.get_subscription_count():
            return
        now = self.inputs.now()
        items = {item.name: item for item in self.inputs.scene.items(now)}
        is_whole = not 0.0 <= now - self.whole_at < REPEAT_INTERVAL
        if is_whole:
            self.whole_at = now
        changed = [item for name, item in items.items() if is_whole or item is not self.shown.get(name)]
        stamp = self.get_clock().now().to_msg()
        markers = [deletion(name) for name in self.shown.keys() - items.keys()] + [marker(item) for item in changed]
        for one in markers:
            one.header.stamp, one.header.frame_id = stamp, "table"
        self.shown = items
        if markers:
            self.markers.publish(MarkerArray(markers=markers))


def deletion(name: str) -> Marker:
    """Return the marker message that deletes the marker of the item `name`."""
    return Marker(ns=name, action=Marker.DELETE)


def marker(item: Item) -> Marker:
    """Return the marker message that shows an item of the scene. The name of the item is the namespace of the marker."""
    message = Marker(ns=item.name, type=MARKER_TYPES[item.shape], action=Marker.ADD, lifetime=Duration(seconds=LIFETIME).to_msg())
    pose, scale, colour = message.pose, message.scale, message.color
    pose.position.x, pose.position.y, pose.position.z = item.position.tolist()
    q = pose.orientation
    q.x, q.y, q.z, q.w = Rotation.from_matrix(item.rotation).as_quat().tolist()
    scale.x, scale.y, scale.z = item.size.tolist()
    colour.r, colour.g, colour.b, colour.a = item.colour
    message.points = [Point(x=x, y=y, z=z) for x, y, z in item.points.tolist()]
    if item.shape is Shape.MESH:
        message.mesh_resource = item.mesh if "://" in item.mesh else f"file://{item.mesh}"
        message.mesh_use_embedded_materials = True
    return message


def main() -> None:
    """Run the node."""
    run(MarkerNode, Priority(nice=NICE))


if __name__ == "__main__":
    main()
