"""ROS node that publishes the images of both high speed cameras, from devices, videos, a folder or a bag (a ROS recording)."""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Generator
from contextlib import closing
from dataclasses import asdict, dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo
from sensor_msgs.msg import CameraInfo, Image
from tt_core.errors import TtError
from tt_core.params import check, param
from tt_core.priority import RESPONSE
from tt_core.ros.clock_offset import answer_clock_pings
from tt_core.ros.convert import camera_to_message, image_to_message
from tt_core.ros.diagnostics import Status
from tt_core.ros.discovery import RECORDERS, is_heard, listeners
from tt_core.ros.node_main import run
from tt_core.ros.params import declare
from tt_core.ros.qos import LATCHED, RECORDED, SENSOR
from tt_core.shared_memory import IMAGE_SEGMENT

from .capture.devices import DeviceCounts, DeviceParams
from .capture.sources import Calibration, SourceError, SourceParams, StampedImage, calibrations, read_images
from .rig import SIDES, high_speed_pair

UPGRADE = 3.0  # s, longest time to wait for reliable subscriptions; estimate_node makes them so once it has discovered this publisher
IMAGES_PER_ACKNOWLEDGEMENT = 200  # number of images between two waits for acknowledgement by all subscribers
SUBSCRIPTION_TIME = 1.0  # s for which the subscriptions must not change; on a busy machine some are discovered so much later than others


class CameraLine(Enum):
    """Messages that this node writes to the terminal, as format strings."""

    PLAYING = "publishing {kind} {path}"
    NOBODY = "nobody subscribes to the images of both cameras after {wait:g} s; publishing {kind} {path} all the same"
    END = "end of {kind} {path}: {count} images"
    STOPPED = "stopped: {error}"


@dataclass(frozen=True)
class ImagePlayParams:
    """Parameters of the node that determine how the images of a recording are published: speed, stamps, repetition and waiting."""

    speed: float = param(1.0, "", "speed of a recording, recorded seconds per second; 0: as fast as it is read", low=0.0, high=100.0)
    restamp: bool = param(False, "", "whether the stamps of a recording are shifted so that its first image is taken now")
    loop: bool = param(False, "", "whether a recording starts again at its end")
    wait: float = param(
        120.0,
        "s",
        "longest time to wait for subscribers before the first image of a recording; a node may take as long to start",
        low=0.0,
        high=3600.0,
    )
    end: bool = param(False, "", "whether the node ends after the last image of a recording, and `linger`")
    linger: float = param(3.0, "s", "time for subscribers to finish before the node ends", low=0.0, high=3600.0)

    def __post_init__(self) -> None:
        """Raise an error for a value outside its range."""
        check(self)


@dataclass(frozen=True)
class Intrinsics:
    """Parameters of the node: intrinsics of one camera."""

    matrix: tuple[float, ...] = param((0.0,) * 9, "pixels", "camera matrix K, by rows", low=-1e6, high=1e6)
    distortion: tuple[float, ...] = param((0.0,) * 5, "", "distortion coefficients k1, k2, p1, p2, k3", low=-1e6, high=1e6)


class CameraNode(Node):
    """Node that publishes images on camera/{left,right}/image_raw, and the intrinsics of the cameras on camera/{left,right}/camera_info.

    The intrinsics are the parameters {left,right}.matrix and {left,right}.distortion; those in a bag replace them.
    """

    def __init__(self) -> None:
        """Declare the parameters, read the first image, then start a thread that publishes the images."""
        super().__init__("camera")
        self.source, self.play, self.device = (
            declare(self, SourceParams),
            declare(self, ImagePlayParams),
            declare(self, DeviceParams, "device."),
        )
        self.counts = DeviceCounts()
        rig = high_speed_pair()
        defaults = [Intrinsics(tuple(camera.matrix.ravel().tolist())) for camera in rig]
        lenses = [declare(self, default, f"{name}.") for name, default in zip(SIDES, defaults, strict=True)]
        self.calibrations = [
            Calibration(
                camera.width,
                camera.height,
                np.reshape(intrinsics.matrix, (3, 3)),
                np.array(intrinsics.distortion),
            )
            for camera, intrinsics in zip(rig, lenses, strict=True)
        ]
        if self.source.kind == "bag":
            for side, calibration in calibrations(Path(self.source.path)).items():
                self.calibrations[side] = calibration
        self.status = Status(self, hardware=f"{self.source.kind} {self.source.path}")
        self.recorded = self.source.kind != "device"
        self.kept_parameters: dict[str, Any] | None = None if self.recorded else {}  # a recording would begin anew
        qos = RECORDED if self.recorded else SENSOR
        self.images = [self.create_publisher(Image, f"camera/{name}/image_raw", qos) for name in SIDES]
        self.infos = [self.create_publisher(CameraInfo, f"camera/{name}/camera_info", LATCHED) for name in SIDES]
        answer_clock_pings(self)
        with closing(self.read_images()) as source:
            first = next(source)  # a source that cannot be read ends the node here
        self.size = first.image.shape
        height, width = self.size
        self.publish_info(width, height)
        if not self.recorded:
            self.create_timer(1.0, lambda: self.status.publish("capturing", **asdict(self.counts)))
        threading.Thread(target=self.publish_all, daemon=True).start()

    def read_images(self) -> Generator[StampedImage, None, None]:
        """Return a generator of the images of the source, from its beginning."""
        return read_images(self.source, self.now, self.device, self.counts)

    def now(self) -> float:
        """Return the present time by the clock of the node, s."""
        return float(self.get_clock().now().nanoseconds * 1e-9)

    def publish_info(self, width: int, height: int) -> None:
        """Publish the intrinsics of both cameras, with the principal point relative to the part of the image that is published.

        Args:
            width: Of the images, pixels.
            height: Of the images, pixels.
        """
        for publisher, calibration, name in zip(self.infos, self.calibrations, SIDES, strict=True):
            matrix = calibration.matrix.copy()
            matrix[:2, 2] -= self.device.region[:2]
            publisher.publish(camera_to_message(width, height, matrix, calibration.distortion, f"{name}_optical"))

    def publish_all(self) -> None:
        """Publish the images of the source until its end, again and again with the parameter `loop`, or until the node ends.

        For a recording, wait for subscribers before, and end the process afterwards if the parameter `end` is set.
        """
        source = {"kind": self.source.kind, "path": self.source.path}
        try:
            heard = not self.recorded or self.wait()
            self.status.terminal.info(CameraLine.PLAYING if heard else CameraLine.NOBODY, wait=self.play.wait, **source)
            count = self.publish_once()
            while self.play.loop and self.context.ok():
                count += self.publish_once()
            self.status.publish("end of the source", images=count)
            self.status.terminal.info(CameraLine.END, count=count, **source)
        except TtError as error:
            self.status.publish(f"stopped: {error}", error=True, reason=error.failure)
            self.status.terminal.warn(CameraLine.STOPPED, error=error)
        except RuntimeError:  # published into a context that a signal has just ended
            if self.context.ok():
                raise
        if self.play.end and self.recorded and self.context.ok():
            time.sleep(self.play.linger)
            signal.raise_signal(signal.SIGTERM)

    def wait(self) -> bool:
        """Wait until other nodes subscribe to the images and to the intrinsics of both cameras.

        Wait also, but for at most UPGRADE, until the subscriptions to the images are reliable.

        Returns:
            Whether there were subscribers to all topics within the time of the parameter `wait`.
        """
        end, patience = time.monotonic() + self.play.wait, math.inf
        known, changed = set[bytes](), math.inf
        while (now := time.monotonic()) < end:
            found = {bytes(info.endpoint_gid) for publisher in (*self.images, *self.infos) for info in self.subscriptions_of(publisher)}
            if found != known:
                known, changed = found, now
            if all(is_heard(self, publisher) for publisher in (*self.images, *self.infos)):
                patience = min(patience, now + UPGRADE)
                if now > changed + SUBSCRIPTION_TIME and (now > patience or all(map(self.is_discovered, self.images, self.infos))):
                    break
            time.sleep(0.05)
        for publisher in self.infos:  # nodes discover publishers in the order of their creation: one that has this message knows the others
            publisher.wait_for_all_acked(Duration(seconds=1.0))
        return now < end

    def subscriptions_of(self, publisher: Publisher) -> list[TopicEndpointInfo]:
        """Return the subscriptions to the topic of a publisher that have been discovered."""
        return list(self.get_subscriptions_info_by_topic(publisher.topic_name))

    def is_discovered(self, images: Publisher, infos: Publisher) -> bool:
        """Return whether the discovery of the subscribers of one camera is complete.

        It is complete if each node that subscribes to the intrinsics also subscribes to the images (recorders excepted), and if all
        subscriptions to the images are reliable.

        Args:
            images: Publisher of the images of the camera.
            infos: Publisher of its intrinsics.
        """
        asked = self.subscriptions_of(images)
        is_reliable = all(info.qos_profile.reliability is ReliabilityPolicy.RELIABLE for info in asked)
        return is_reliable and listeners(self, infos.topic_name) - RECORDERS <= {info.node_name for info in asked}

    def publish_once(self) -> int:
        """Publish the images of the source once, from beginning to end.

        Returns:
            The number of images that were published.

        Raises:
            SourceError: An image differs in size from the first one.
        """
        count, start, shift = 0, time.monotonic(), 0.0
        first: StampedImage | None = None
        for image in self.read_images():
            if image.image.shape != self.size:
                raise SourceError(f"image of {SIDES[image.side]} has shape {image.image.shape}, the first one {self.size}")
            if first is None:
                first, shift = image, self.now() - image.time if self.play.restamp else 0.0
            if self.play.speed and self.recorded:
                time.sleep(max(0.0, (image.time - first.time) / self.play.speed - (time.monotonic() - start)))
            if self.recorded and not count % IMAGES_PER_ACKNOWLEDGEMENT:  # no image is overwritten before it has arrived
                for publisher in self.images:
                    publisher.wait_for_all_acked(Duration(seconds=1.0))
            self.images[image.side].publish(image_to_message(image.image, image.time + shift, f"{SIDES[image.side]}_optical"))
            count += 1
            if not self.context.ok():
                break
        return count


def main() -> None:
    """Run the node."""
    run(CameraNode, RESPONSE, IMAGE_SEGMENT)


if __name__ == "__main__":
    main()
