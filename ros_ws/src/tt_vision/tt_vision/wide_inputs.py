"""The subscriptions of a node to the wide cameras: their poses, their intrinsics, and the pixels at which they see the ball."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo
from tt_core.errors import TtError
from tt_core.ros.convert import camera_from_message, pixel_from_message
from tt_core.ros.diagnostics import Status
from tt_core.ros.inputs import INFO_FORM, Input, MessageForm
from tt_core.ros.params import declare
from tt_core.ros.qos import LATCHED, SENSOR
from tt_core.ros.refusals import Refusals
from tt_core.states import Array

from .camera import Camera
from .camera_pose import CameraPose
from .rig import WIDE_SIDES, wide_pair

PIXEL_FORM = MessageForm(PointStamped, 1024)  # a pixel has 60 bytes


class WideInputs:
    """Subscriptions of a node to the topics camera/{wide_left,wide_right}/ball and camera/{wide_left,wide_right}/camera_info.

    The poses of the cameras are the parameters {wide_left,wide_right}.rotation and {wide_left,wide_right}.translation of the node.

    Attributes:
        cameras: The left and the right wide camera; an element is replaced when its camera_info arrives.
        inputs: The subscriptions.
    """

    def __init__(
        self, node: Node, status: Status, on_pixel: Callable[[float, int, Array], None], on_calibration: Callable[[], None]
    ) -> None:
        """Declare the parameters of the camera poses, and subscribe to the topics.

        Args:
            node: The node that subscribes.
            status: Diagnostics of the node, in which refused messages are reported.
            on_pixel: Called with each pixel of a camera whose intrinsics are known: stamp (s), camera (0 left, 1 right), pixel (2,). If it
                raises a TtError, the pixel is reported as refused.
            on_calibration: Called after an element of `cameras` has been replaced.
        """
        self.cameras: list[Camera] = list(wide_pair())
        self._poses = [declare(node, CameraPose.of(camera), f"{name}.") for name, camera in zip(WIDE_SIDES, self.cameras, strict=True)]
        self._infos: list[CameraInfo | None] = [None, None]
        self._on_pixel, self._on_calibration = on_pixel, on_calibration
        self._bad_infos, self._bad_pixels = Refusals(status, "camera_info of a wide camera"), Refusals(status, "pixel")
        self.inputs = list[Input]()
        for side, name in enumerate(WIDE_SIDES):
            info, pixel = f"camera/{name}/camera_info", f"camera/{name}/ball"
            take_info, take_pixel = partial(self._take_info, side), partial(self._take_pixel, side)
            self.inputs.append(Input(node, INFO_FORM, info, take_info, LATCHED, refused=self._bad_infos))
            self.inputs.append(Input(node, PIXEL_FORM, pixel, take_pixel, SENSOR, refused=self._bad_pixels))

    def _take_info(self, side: int, message: CameraInfo) -> None:
        """Replace a camera by one with the intrinsics of a message, unless they are the same as before."""
        message.header = CameraInfo().header  # drivers repeat a calibration with other stamps
        if message == self._infos[side]:
            return
        try:
            width, height, matrix, distortion = camera_from_message(message)
            old = self.cameras[side]
            camera = Camera.from_matrix(old.rotation, old.translation, matrix, width, height, distortion, old.pixel_size)
            self.cameras[side], self._infos[side] = self._poses[side].placed(camera), message
        except TtError as error:
            self._bad_infos(error)
            return
        self._on_calibration()

    def _take_pixel(self, side: int, message: PointStamped) -> None:
        """Pass a pixel to the node; drop it while the intrinsics of its camera are unknown."""
        if self._infos[side] is None:
            return
        try:
            stamp, pixel = pixel_from_message(message)
            self._on_pixel(stamp, side, pixel)
        except TtError as error:
            self._bad_pixels(error)
