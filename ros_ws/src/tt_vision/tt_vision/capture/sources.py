"""Sources of the images of two cameras: a folder, two videos, a bag, or two devices. Each is a generator of images in the order of time."""

from __future__ import annotations

import re
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from tt_core.arrays import Image
from tt_core.errors import TtError
from tt_core.params import check, param
from tt_core.ros.bags import Bag
from tt_core.ros.convert import camera_from_message

from ..rig import SIDES
from .devices import DeviceCounts, DeviceParams, grabs

SOURCE_KINDS = ("folder", "video", "bag", "device")
STAMPED = re.compile(r"(left|right)[_\-/](\d+(?:\.\d+)?)\.(?:png|pgm|tiff?|bmp|jpe?g)$", re.IGNORECASE)
NANOSECONDS = 1e14  # a whole number above it is a stamp in nanoseconds (later than 2 January 1970), a smaller one is in seconds


class SourceError(TtError):
    """Error: a source of images cannot be opened or read."""


class NoImages(SourceError):
    """Error: a source has no images of either camera."""


class NotAnImage(SourceError):
    """Error: a file is not an image, or an image has pixels of another type than uint8 or uint16."""


class CannotOpen(SourceError):
    """Error: a video cannot be opened."""

    def __init__(self, source: str) -> None:
        """Keep the path of the video."""
        super().__init__(f"cannot open {source!r}")
        self.source = source


class MissingSide(SourceError):
    """Error: two videos or devices are needed, and at least one is not given."""

    def __init__(self, kind: str) -> None:
        """Keep the kind of the source: "video" or "device"."""
        super().__init__(f"two {kind}s are needed: `path` is the left one, `right` the right one")
        self.kind = kind


class NotDeviceNumbers(SourceError):
    """Error: a device is given neither by a number nor by a path such as /dev/video0."""

    def __init__(self, devices: Sequence[str]) -> None:
        """Keep what was given for the devices."""
        super().__init__(f"devices are two numbers, or paths such as /dev/video0, got {list(devices)}")
        self.devices = list(devices)


class StampedImage(NamedTuple):
    """An image of one of the two cameras, with its time.

    Attributes:
        side: Which camera, an index in SIDES: 0 left, 1 right.
        time: Stamp of the image, s.
        image: (h, w) uint8 or uint16, grey levels.
    """

    side: int
    time: float
    image: Image


class Calibration(NamedTuple):
    """Intrinsics of a camera, as a message sensor_msgs/CameraInfo holds them.

    Attributes:
        width: Of the image, pixels.
        height: Of the image, pixels.
        matrix: (3, 3) intrinsic matrix K, pixels.
        distortion: (n,) distortion coefficients in the order of OpenCV.
    """

    width: int
    height: int
    matrix: np.ndarray
    distortion: np.ndarray


@dataclass(frozen=True)
class SourceParams:
    """Parameters of the source from which the images of both cameras are read."""

    kind: str = param("folder", "", "kind of the source: a folder of images, two videos, a bag, or two devices", choices=SOURCE_KINDS)
    path: str = param("", "", "path of the folder, the bag or the left video, or number of the left device")
    right: str = param("", "", "path of the right video, or number of the right device; empty for a folder or a bag")
    frame_rate: float = param(
        900.0, "1/s", "frame rate of videos; of devices, only to count the frames that they drop", low=0.1, high=100000.0
    )

    def __post_init__(self) -> None:
        """Raise an error for a value outside its range."""
        check(self)


def read_images(
    params: SourceParams, now: Callable[[], float], device: DeviceParams | None = None, counts: DeviceCounts | None = None
) -> Generator[StampedImage, None, None]:
    """Return a generator of the images of a source, in the order of time.

    Args:
        params: Kind and path of the source.
        now: Returns the present time, s, by which images of devices are stamped; other sources do not use it.
        device: Settings of devices; None for the defaults.
        counts: Counts of faults of devices, increased in place; None if they are not wanted.

    Raises:
        MissingSide: One of the two videos or devices is not given. A source that cannot be read raises its error at the first image.
    """
    if params.kind in ("video", "device") and not (params.path and params.right):
        raise MissingSide(params.kind)
    if params.kind == "folder":
        return from_folder(Path(params.path))
    if params.kind == "video":
        return from_videos([params.path, params.right], params.frame_rate)
    if params.kind == "bag":
        return from_bag(Path(params.path))
    return from_devices([params.path, params.right], now, device or DeviceParams(), params.frame_rate, counts or DeviceCounts())


def from_folder(path: Path) -> Generator[StampedImage, None, None]:
    """Read the image files of a folder and its subfolders, in the order of time.

    A file of the left camera is named left_TIME.png or left/TIME.png, one of the right camera likewise; the other usual types of image
    files are read, too. TIME is in nanoseconds if it is a whole number above NANOSECONDS, else in seconds.

    Args:
        path: The folder.

    Yields:
        The images of both cameras.

    Raises:
        NoImages: The folder has no such files.
        NotAnImage: A file cannot be read as an image.
    """
    found = []
    for file in path.rglob("*"):
        if match := STAMPED.search(file.relative_to(path).as_posix()):
            side, stamp = match[1].lower(), match[2]
            time = int(stamp) * 1e-9 if "." not in stamp and int(stamp) > NANOSECONDS else float(stamp)
            found.append((time, SIDES.index(side), file))
    if not found:
        raise NoImages(f"no images named left_TIME.png or right_TIME.png in {path}")
    for time, side, file in sorted(found):
        image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        if image is None:
            raise NotAnImage(f"{file} is no image")
        yield StampedImage(side, time, to_grey(image))


def from_videos(paths: Sequence[str], frame_rate: float) -> Generator[StampedImage, None, None]:
    """Read two videos whose first frames were taken at the same instant, until one of them ends.

    Args:
        paths: Paths of the left and the right video.
        frame_rate: Frames per second. Frame k is stamped k / frame_rate s. The frame rate in the files is not used, because high speed
            videos are often stored with a lower one for players.

    Yields:
        The left and the right image of each frame.

    Raises:
        CannotOpen: A video cannot be opened.
    """
    with closing(_Captures(paths)) as captures:
        for k, images in enumerate(captures):
            for side, image in enumerate(images):
                yield StampedImage(side, k / frame_rate, image)


def from_devices(
    numbers: Sequence[str], now: Callable[[], float], params: DeviceParams, frame_rate: float, counts: DeviceCounts
) -> Generator[StampedImage, None, None]:
    """Read two camera devices of the operating system, without end; see `devices.grabs`.

    Args:
        numbers: The left and the right device, each a number or a path such as /dev/video0.
        now: Returns the present time, s, by which images are stamped.
        params: Settings of the devices.
        frame_rate: Frames per second, by which dropped frames are counted.
        counts: Counts of faults, increased in place.

    Yields:
        The left and the right image of each frame.

    Raises:
        NotDeviceNumbers: A device is given neither by a number nor by such a path.
    """
    found = [re.fullmatch(r"(?:/dev/video)?(\d+)", number) for number in numbers]
    if not all(found):
        raise NotDeviceNumbers(numbers)
    for time, images in grabs([int(match[1]) for match in found if match], now, params, frame_rate, counts):
        for side, image in enumerate(images):
            yield StampedImage(side, time, to_grey(image))


class _Captures:
    """Iterates over the frames of several videos, one image of each at a time, until one of them ends."""

    def __init__(self, sources: Sequence[str]) -> None:
        self._captures = [cv2.VideoCapture(source) for source in sources]
        for source, capture in zip(sources, self._captures, strict=True):
            if not capture.isOpened():
                self.close()
                raise CannotOpen(source)

    def __iter__(self) -> Iterator[list[Image]]:
        while sum(capture.grab() for capture in self._captures) == len(self._captures):  # all are grabbed before any is decoded
            yield [to_grey(capture.retrieve()[1]) for capture in self._captures]

    def close(self) -> None:
        for capture in self._captures:
            capture.release()


def from_bag(path: Path) -> Generator[StampedImage, None, None]:
    """Read the images on the topics camera/{left,right}/image_raw of a bag (a ROS recording).

    Args:
        path: A bag in any format that `tt_core.ros.bags` reads.

    Yields:
        The images of both cameras with the stamps in the headers of their messages.

    Raises:
        NoImages: The bag has no images on these topics.
    """
    from tt_core.ros.convert import image_from_message, seconds  # here, because no other source needs ROS

    count = 0
    for side, message in _messages(path, "image_raw"):
        image = image_from_message(message)
        native = image.astype(image.dtype.newbyteorder("="), copy=False)
        yield StampedImage(side, seconds(message.header.stamp), native)
        count += 1
    if not count:
        raise NoImages(f"no images on {' and '.join(f'camera/{side}/image_raw' for side in SIDES)} in {path}")


def calibrations(path: Path) -> dict[int, Calibration]:
    """Read the intrinsics of both cameras from the topics camera/{left,right}/camera_info of a bag (a ROS recording).

    Args:
        path: The bag.

    Returns:
        The intrinsics by side, 0 left and 1 right. A side without messages is left out; so is a camera that is not calibrated (K[0] = 0).

    Raises:
        TtError: The bag cannot be read, or its model of the lens distortion is not known.
    """
    return {side: Calibration(*camera_from_message(m)) for side, m in _messages(path, "camera_info") if m.k[0] != 0.0}


def _messages(path: Path, kind: str) -> Iterator[tuple[int, Any]]:
    """Yield the side (0 left, 1 right) and the decoded message for each message of a bag on camera/{left,right}/{kind}."""
    with Bag(path) as bag:
        sides = {bag.find(f"camera/{name}/{kind}"): side for side, name in enumerate(SIDES)}
        for message in bag.messages([topic for topic in sides if topic] or ["none"]):
            yield sides[message.topic], bag.decode(message)


def to_grey(image: np.ndarray) -> Image:
    """Convert an image to grey levels.

    Args:
        image: (h, w) grey levels, or (h, w, 3) in OpenCV's order of colours (blue, green, red).

    Returns:
        (h, w) of the same type.

    Raises:
        NotAnImage: The type of the image is neither uint8 nor uint16.
    """
    if image.ndim == 3:
        image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    if image.dtype not in (np.uint8, np.uint16):
        raise NotAnImage(f"image of dtype uint8 or uint16 expected, got {image.dtype}")
    return image
