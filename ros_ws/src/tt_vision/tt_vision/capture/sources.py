"""Sources of the images of two cameras: a folder, videos, a bag, or devices. Each is a generator of images in the order of time."""

from __future__ import annotations

import re
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from tt_core.errors import TtError
from tt_core.params import check, param
from tt_core.ros.bags import Bag
from tt_core.ros.convert import camera_from_message

from ..rig import SIDES
from .burst import Image
from .devices import DeviceCounts, DeviceParams, grabs

KINDS = ("folder", "video", "bag", "device")
STAMPED = re.compile(r"(left|right)[_\-/](\d+(?:\.\d+)?)\.(?:png|pgm|tiff?|bmp|jpe?g)$", re.IGNORECASE)
NANOSECONDS = 1e14  # a whole number above it is a stamp in nanoseconds, below it in seconds: one day after 1970 and three million years


class SourceError(TtError):
    """A source that cannot be opened or read."""


class NoImages(SourceError):
    """A source without images of either camera."""


class NotAnImage(SourceError):
    """A file that is no image, or an image of a type that is not known."""


class CannotOpen(SourceError):
    """A video, or a device, that cannot be opened."""

    def __init__(self, source: str) -> None:
        """Keep the path or number."""
        super().__init__(f"cannot open {source!r}")
        self.source = source


class MissingSide(SourceError):
    """Two videos or devices are needed, and one is not given."""

    def __init__(self, kind: str) -> None:
        """Keep the kind of the source."""
        super().__init__(f"two {kind}s are needed: `path` is the left one, `right` the right one")
        self.kind = kind


class NotDeviceNumbers(SourceError):
    """Devices that are not given by two numbers, or by paths that end in one."""

    def __init__(self, devices: Sequence[str]) -> None:
        """Keep what was given."""
        super().__init__(f"devices are two numbers, or paths such as /dev/video0, got {list(devices)}")
        self.devices = list(devices)


class StampedImage(NamedTuple):
    """An image of one of the two cameras.

    Attributes:
        side: Index in SIDES: 0 left, 1 right.
        time: s.
        image: (h, w) uint8 or uint16.
    """

    side: int
    time: float
    image: Image


class Calibration(NamedTuple):
    """Intrinsics of a camera as camera_info holds them.

    Attributes:
        width: Pixels.
        height: Pixels.
        matrix: (3, 3) K, pixels.
        distortion: (n,) coefficients in the order of OpenCV.
    """

    width: int
    height: int
    matrix: np.ndarray
    distortion: np.ndarray


@dataclass(frozen=True)
class SourceParams:
    """Where images come from."""

    kind: str = param("folder", "", "kind of the source: a folder of images, two videos, a bag, or two devices", choices=KINDS)
    path: str = param("", "", "path of the folder, the bag or the left video, or number of the left device")
    right: str = param("", "", "path of the right video, or number of the right device; empty for a folder or a bag")
    frame_rate: float = param(
        900.0, "1/s", "frame rate of videos; of devices, only to count the frames that they drop", low=0.1, high=100000.0
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


def read_images(
    params: SourceParams, now: Callable[[], float], device: DeviceParams | None = None, counts: DeviceCounts | None = None
) -> Generator[StampedImage, None, None]:
    """Read the images of a source in the order of time.

    Args:
        params: The source.
        now: Returns the time, s, that stamps the images of devices.
        device: How devices are set up.
        counts: Takes the frames that devices drop.

    Raises:
        SourceError: The source cannot be opened; at the first image.
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
    """Read images named left_TIME.png or left/TIME.png, and likewise of the right camera.

    Args:
        path: The folder. TIME is in nanoseconds if it is a whole number above NANOSECONDS, else in seconds.

    Raises:
        NoImages: The folder has no such images.
        NotAnImage: A file cannot be read.
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
    """Read two videos that start together.

    Args:
        paths: Of the left and the right video.
        frame_rate: 1/s. Frame k is at k / frame_rate whatever the files say, because players cannot show 900 frames a second.

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
    """Read two cameras that the operating system knows; their images are stamped when they are grabbed.

    Args:
        numbers: Of the left and the right device.
        now: Returns the time, s.
        params: How the devices are set up.
        frame_rate: 1/s, to count the frames that they drop.
        counts: Takes these numbers.

    Raises:
        NotDeviceNumbers: `numbers` are no numbers and no paths such as /dev/video0.
        DeviceError: A device cannot be opened or set up.
    """
    found = [re.fullmatch(r"(?:/dev/video)?(\d+)", number) for number in numbers]
    if not all(found):
        raise NotDeviceNumbers(numbers)
    for time, images in grabs([int(match[1]) for match in found if match], now, params, frame_rate, counts):
        for side, image in enumerate(images):
            yield StampedImage(side, time, to_grey(image))


class _Captures:
    """Frames of several captures taken together, until one ends."""

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
    """Read the images on /camera/{left,right}/image_raw of a bag.

    Args:
        path: A bag of any kind that `tt_core.ros.bags` reads.

    Yields:
        Images with the stamps of their messages.

    Raises:
        NoImages: The bag has no images.
        BagError: The bag cannot be read.
        BadMessage: An image has an encoding that is not known.
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
    """Return the intrinsics in camera/{left,right}/camera_info of a bag, by side. A camera that is not calibrated (K[0] = 0) is left out.

    Raises:
        TtError: A lens model is not known, or the bag cannot be read.
    """
    return {side: Calibration(*camera_from_message(m)) for side, m in _messages(path, "camera_info") if m.k[0] != 0.0}


def _messages(path: Path, kind: str) -> Iterator[tuple[int, Any]]:
    """Yield the index in SIDES and the message for each message on camera/{left,right}/{kind}."""
    with Bag(path) as bag:
        sides = {bag.find(f"camera/{name}/{kind}"): side for side, name in enumerate(SIDES)}
        for message in bag.messages([topic for topic in sides if topic] or ["none"]):
            yield sides[message.topic], bag.decode(message)


def to_grey(image: np.ndarray) -> Image:
    """Return an image, in OpenCV's colours or grey, as a grey one.

    Raises:
        NotAnImage: Its type is neither uint8 nor uint16.
    """
    if image.ndim == 3:
        image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    if image.dtype not in (np.uint8, np.uint16):
        raise NotAnImage(f"image of dtype uint8 or uint16 expected, got {image.dtype}")
    return image
