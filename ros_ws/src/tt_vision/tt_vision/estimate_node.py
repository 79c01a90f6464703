"""ROS node that publishes position, velocity and spin of each ball, measured from the images of the two high speed cameras, or of one.

A burst holds the images of one ball's passage through these cameras (about six pairs).
"""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from enum import Enum
from functools import partial
from typing import Any

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image
from tt_core.constants import RPM
from tt_core.errors import BadShape, TtError
from tt_core.failures import Failure
from tt_core.params import check, param
from tt_core.priority import MEASUREMENT
from tt_core.ros.clock_offset import answer_clock_pings
from tt_core.ros.convert import ball_to_message, camera_from_message, image_from_message, stamp_seconds
from tt_core.ros.diagnostics import Event, Status
from tt_core.ros.inputs import INFO_FORM, Input, MessageForm
from tt_core.ros.node_main import run
from tt_core.ros.params import declare, declare_physics
from tt_core.ros.qos import LATCHED, RECORDED, RELIABLE, SENSOR
from tt_core.ros.refusals import Refusals

from .camera import Camera
from .camera_pose import CameraPose
from .capture.assembler import Assembler, BurstParams
from .capture.burst import Burst
from .detection.illumination import CalibratedLamps
from .detection.lens_correction import Lens, straighten
from .first_estimate import FirstEstimator
from .measure import Measurement, first_measurement, measure_burst
from .rig import SIDES, high_speed_pair
from .spin.registration import SearchParams
from .warm import warm

IMAGE_FORM = MessageForm(Image, 2**24 + 4096)  # for 4096 x 4096 pixels of 8 bits; the high speed cameras send 54 kB
MOST_HELD = 8  # number of bursts, of twelve images of 54 kB each


class BurstReason(Enum):
    """Reasons why the node does not measure a burst (the images of one ball's passage); codes of `tt_core.failures.Failure`."""

    NO_CAMERA_INFO = "no camera_info yet"
    UNUSABLE = "{error}"


class EstimateLine(Enum):
    """Messages that this node writes to the terminal, as format strings: one for each ball that is estimated, measured or refused."""

    FIRST = "first estimate: {speed:.2f} m/s, spin {rpm:.0f} rpm"
    MEASURED = "ball measured from {frames} frames: {speed:.2f} m/s, spin {rpm:.0f} rpm (x {x:.0f}, y {y:.0f}, z {z:.0f})"
    REFUSED = "ball not measured: {reason}"


@dataclass(frozen=True)
class EstimateParams:
    """Parameters of the node that determine how the spin of the ball is measured."""

    fast: bool = param(False, "", "whether a ball is measured in less time, with larger errors of the spin")
    max_spin: float = param(
        0.0,
        "rad/s",
        "largest spin that is searched for slow cameras, before which a ball turns by more than 80 deg; 0: none",
        low=0.0,
        high=3000.0,
    )

    def __post_init__(self) -> None:
        """Raise an error for a value outside its range."""
        check(self)

    @property
    def search(self) -> SearchParams:
        """Parameters of the spin search, with the values that are set here."""
        return dataclasses.replace(SearchParams.fast() if self.fast else SearchParams(), max_spin=self.max_spin)


@dataclass(frozen=True)
class LampParams:
    """Parameters of the node: positions and strengths of calibrated lamps; none by default, then the light is fitted to each burst."""

    positions: tuple[float, ...] = param((), "m", "x, y, z of each lamp in `table`, one lamp after the other", low=-100.0, high=100.0)
    strengths: tuple[float, ...] = param(
        (), "", "brightness that each lamp gives a white surface 1 m away; empty without calibrated lamps", low=0.0, high=1e6
    )
    ambient: float = param(0.0, "", "brightness of a white surface in the light of the room", low=0.0, high=1e6)

    def __post_init__(self) -> None:
        """Raise an error for a value outside its range, and unless there are three coordinates for each strength."""
        check(self)
        if len(self.positions) != 3 * len(self.strengths):
            raise BadShape("lamps.positions", (len(self.positions),), (3 * len(self.strengths),))


def read_poses(read: Callable[..., Any]) -> list[Camera]:
    """Return the left and the right camera at the poses that the parameters {left,right}.rotation and {left,right}.translation give.

    Only their poses are meant to be used; the intrinsics are the defaults.

    Args:
        read: Function that reads parameters. It takes an instance of a parameter class with the defaults (or the class itself) and the
            prefix of the parameters' names, and returns an instance with the values of the parameters.
    """
    return [read(CameraPose.of(camera), f"{name}.").placed(camera) for name, camera in zip(SIDES, high_speed_pair(), strict=True)]


def read_lamps(read: Callable[..., Any]) -> CalibratedLamps | None:
    """Return the calibrated lamps that the parameters lamps.* give; None if all strengths are 0 or there are none.

    Args:
        read: Function that reads parameters, see `read_poses`.
    """
    lamps = read(LampParams, "lamps.")
    if not any(lamps.strengths):
        return None
    return CalibratedLamps(np.reshape(lamps.positions, (-1, 3)), np.array(lamps.strengths), lamps.ambient)


class EstimateNode(Node):
    """Node that subscribes to camera/{left,right}/image_raw and camera_info, and publishes the ball on ball/first and ball/measured.

    The images are put together to bursts: those of one ball's passage through the cameras. Each frame is processed while the next one
    arrives. After the last frame of a burst, ball/first is published at once: an estimate at half the resolution that is accurate enough to
    start a swing. Then ball/measured follows, which replaces it. Each passage gives one message on each topic; with the parameter `refined`
    a second ball/measured follows from more frames. The model of the air in the parameters `physics` determines how the flight is curved
    between the frames. The poses of the cameras are the parameters {left,right}.rotation and {left,right}.translation.
    """

    def __init__(self) -> None:
        """Declare the parameters, compile the functions of the measurement, then subscribe to the topics."""
        super().__init__("estimate")
        self.assembler = Assembler(declare(self, BurstParams))
        self.search = declare(self, EstimateParams).search
        self.air = declare_physics(self).air
        self.lamps, self.poses = read_lamps(partial(declare, self)), read_poses(partial(declare, self))
        self.infos: list[CameraInfo | None] = [None, None]
        self.lenses: list[Lens | None] = [None, None]
        alone = self.assembler.params.alone
        self.sides = [SIDES.index(alone)] if alone else [0, 1]
        self.estimator: FirstEstimator | None = None  # first estimate of the present ball, in progress
        self.searching = ThreadPoolExecutor(1, "spin search")
        self.held: deque[Burst] = deque(maxlen=MOST_HELD)  # bursts that came before the calibration of their cameras
        self.measured, self.refused = 0, 0
        warm(high_speed_pair())
        self.status = Status(self)
        self.firsts = self.create_publisher(Odometry, "ball/first", RELIABLE)
        self.balls = self.create_publisher(Odometry, "ball/measured", RELIABLE)
        answer_clock_pings(self)
        self.bad_infos = [Refusals(self.status, f"camera_info of {name}") for name in SIDES]
        self.bad_images = [Refusals(self.status, f"image of {name}") for name in SIDES]
        inputs = list[Input]()
        for side, name in enumerate(SIDES):
            info, image = f"camera/{name}/camera_info", f"camera/{name}/image_raw"
            on_info, on_image = partial(self.on_info, side), partial(self.on_image, side)
            inputs.append(Input(self, INFO_FORM, info, on_info, LATCHED, refused=self.bad_infos[side]))
            inputs.append(Input(self, IMAGE_FORM, image, on_image, (SENSOR, RECORDED), refused=self.bad_images[side]))
        self.status.wait_for([one for side in self.sides for one in inputs[2 * side : 2 * side + 2]])

    def on_info(self, side: int, message: CameraInfo) -> None:
        """Store the intrinsics of a camera, unless they are the same as before; then measure the bursts that have waited for them.

        Args:
            side: Which camera, 0 left, 1 right.
            message: The intrinsics.
        """
        message.header = CameraInfo().header  # drivers repeat a calibration with other stamps
        if message == self.infos[side]:
            return
        try:
            width, height, matrix, distortion = camera_from_message(message)
            self.lenses[side], self.infos[side] = Lens(matrix, distortion, width, height), message
        except TtError as error:
            self.bad_infos[side](error)
            return
        while self.held and len(self.known_lenses()) == len(self.sides):
            self.on_burst(self.held.popleft())

    def known_lenses(self) -> list[Lens]:
        """Return the lenses (intrinsics) of the cameras that are used, without those whose camera_info has not arrived yet."""
        return [lens for lens in (self.lenses[side] for side in self.sides) if lens is not None]

    def on_image(self, side: int, message: Image) -> None:
        """Add an image; measure the burst that is complete with it, or else process the newest frame for the first estimate.

        Args:
            side: Which camera, 0 left, 1 right.
            message: The image. It is refused if its size is not that of the camera's calibration.
        """
        try:
            image, lens = image_from_message(message), self.lenses[side]
            if lens is not None and image.shape != (lens.height, lens.width):
                raise BadShape("image", image.shape, f"{(lens.height, lens.width)} of camera_info")
            burst = self.assembler.add(side, stamp_seconds(message.header.stamp), image)
        except TtError as error:
            self.bad_images[side](error)
            return
        if burst is not None:
            self.on_burst(burst)
        else:
            self.add_newest()

    def add_newest(self) -> None:
        """Process the newest frame (pair of images) of the present ball for its first estimate, while the next frame arrives.

        Nothing is done while the intrinsics of a camera are unknown, or if images have to be resampled because of lens distortion.
        """
        pairs = self.assembler.present
        if not pairs:
            self.estimator = None
            return
        if len(pairs) == 1 and (self.estimator is None or self.estimator.times != [pairs[0].time]):
            self.estimator = self.new_estimator()
        if self.estimator is None or len(self.estimator.times) == len(pairs):
            return
        newest, times = pairs[-1], self.estimator.times
        if len(times) != len(pairs) - 1 or any(time >= newest.time for time in times):  # they arrived out of order
            self.estimator = None
            return
        self.estimator.add(newest.time, [one.image for one in newest.seen], [one.detection for one in newest.seen])

    def new_estimator(self) -> FirstEstimator | None:
        """Create the `FirstEstimator` for a new ball.

        Returns:
            None while the intrinsics of a camera are unknown, or if a lens has so much distortion that images have to be resampled.
        """
        lenses = self.known_lenses()
        if len(lenses) < len(self.sides) or not all(lens.is_nearly_straight for lens in lenses):
            return None
        cameras = [lens.camera(self.poses[side]) for lens, side in zip(lenses, self.sides, strict=True)]
        return FirstEstimator(cameras, self.search, self.lamps, self.searching)

    def add_rest(self, burst: Burst) -> FirstEstimator | None:
        """Add those frames of a complete burst to the present `FirstEstimator` that have not been processed yet, and return it.

        Returns:
            None if the frames of this burst were not processed while they arrived.
        """
        estimator, self.estimator = self.estimator, None
        if estimator is None or estimator.times != burst.times[: len(estimator.times)].tolist():
            return None
        for k in range(len(estimator.times), len(burst)):
            estimator.add(float(burst.times[k]), [stack[k] for stack in burst.images], [row[k] for row in burst.detections])
        if self.assembler.present:  # a longer burst of the same ball follows
            self.estimator = estimator
        return estimator

    def on_burst(self, burst: Burst) -> None:
        """Measure position, velocity and spin of the ball from a burst, and publish the ball or the reason why there is no result.

        While the intrinsics of a camera are unknown, the burst is kept and measured later.

        Args:
            burst: The images of one ball's passage, without cameras.
        """
        last, lenses = float(burst.times[-1]), self.known_lenses()
        if len(lenses) < len(self.sides):
            self.held.append(burst)  # it is measured when the calibration arrives, whichever node was started first
            self._refuse(Failure(BurstReason.NO_CAMERA_INFO), last)
            return
        try:
            straight = straighten(burst, lenses, [self.poses[side] for side in self.sides])
            estimator = self.add_rest(straight)
            first = None if estimator is None else estimator.estimate(straight)
            if first is not None and not burst.refined:
                self.publish_first(first_measurement(straight, first, self.air), last)
            result = measure_burst(straight, air=self.air, lamps=self.lamps, search=self.search, first=first)
        except TtError as error:
            self._refuse(Failure(BurstReason.UNUSABLE, error=error), last)
            return
        if result.ball is None or result.reason is not None:
            self._refuse(result.reason, last, residual=f"{result.residual:.3f}")
            return
        self.balls.publish(ball_to_message(result.ball))
        self.measured += not burst.refined
        spin_rpm = np.round(result.ball.spin / RPM).astype(int).tolist()
        self.status.publish(
            Event.REFINED if burst.refined else Event.MEASURED,
            stamp=last,
            **self._counts(),
            spin_rpm=spin_rpm,
            residual=f"{result.residual:.3f}",
            frames=result.used,
        )
        self.status.terminal.info(
            EstimateLine.MEASURED,
            frames=result.used,
            speed=np.linalg.norm(result.ball.velocity),
            rpm=np.linalg.norm(result.ball.spin) / RPM,
            **dict(zip("xyz", spin_rpm, strict=True)),
        )

    def publish_first(self, result: Measurement, last: float) -> None:
        """Publish a first estimate on ball/first, if it contains a ball.

        Args:
            result: The first estimate as a measurement.
            last: s, time of the last frame.
        """
        if result.ball is None:
            return
        self.firsts.publish(ball_to_message(result.ball))
        self.status.publish(Event.FIRST_ESTIMATE, stamp=last)
        rpm = np.linalg.norm(result.ball.spin) / RPM
        self.status.terminal.info(EstimateLine.FIRST, speed=np.linalg.norm(result.ball.velocity), rpm=rpm)

    def close(self) -> None:
        """End the thread that searches the spin."""
        self.searching.shutdown()

    def _refuse(self, reason: Failure | None, stamp: float, **values: Any) -> None:
        """Report in diagnostics and terminal why a burst gives no measurement.

        Args:
            reason: Why.
            stamp: s, time of the last frame of the burst.
            **values: Further values for the diagnostics.
        """
        self.refused += 1
        self.status.publish(f"refused: {reason}", stamp=stamp, warn=True, reason=reason, **self._counts(), **values)
        self.status.terminal.warn(EstimateLine.REFUSED, reason=reason)

    def _counts(self) -> dict[str, Any]:
        """Return how many balls were measured and refused, and how many images were not used, by the reason."""
        return {"measured": self.measured, "refused": self.refused, **dataclasses.asdict(self.assembler.counts)}


def main() -> None:
    """Run the node."""
    run(EstimateNode, MEASUREMENT)


if __name__ == "__main__":
    main()
