"""Where images of the two cameras come from: a folder, videos, a bag, devices. Each is a generator of shots in the order of time."""

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


class Shot(NamedTuple):
    """side: 0 left, 1 right. time: s. image: (h, w) uint8 or uint16."""

    side: int
    time: float
    image: Image


class Calibration(NamedTuple):
    """As recorded: pixels; K (3, 3); distortion (n,)."""

    width: int
    height: int
    matrix: np.ndarray
    distortion: np.ndarray


@dataclass(frozen=True)
class SourceParams:
    """Where images come from."""

    kind: str = param("folder", "", "what `path` is: a folder of images, videos, devices or a bag", choices=KINDS)
    path: str = param("", "", "folder, bag or left video, or number of the left device")
    right: str = param("", "", "right video, or number of the right device")
    frame_rate: float = param(
        900.0, "1/s", "frame rate of videos, and of devices, to count the frames that they drop", low=0.1, high=100000.0
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


def shots(
    params: SourceParams, now: Callable[[], float], device: DeviceParams | None = None, counts: DeviceCounts | None = None
) -> Generator[Shot, None, None]:
    """now: s, the clock that stamps the images of devices. device, counts: of
    them. Raises SourceError at the first shot for what cannot be opened.
    """
    if params.kind == "folder":
        return from_folder(Path(params.path))
    if params.kind == "video":
        return from_videos([params.path, params.right], params.frame_rate)
    if params.kind == "bag":
        return from_bag(Path(params.path))
    return from_devices([params.path, params.right], now, device or DeviceParams(), params.frame_rate, counts or DeviceCounts())


def from_folder(path: Path) -> Generator[Shot, None, None]:
    """Images named left_TIME.png or left/TIME.png, the same for right; TIME in nanoseconds when whole and long, else in seconds."""
    found = []
    for file in path.rglob("*"):
        if match := STAMPED.search(file.relative_to(path).as_posix()):
            side, stamp = match[1].lower(), match[2]
            time = int(stamp) * 1e-9 if "." not in stamp and int(stamp) > NANOSECONDS else float(stamp)
            found.append((time, SIDES.index(side), file))
    if not found:
        raise SourceError(f"no images named left_TIME.png or right_TIME.png in {path}")
    for time, side, file in sorted(found):
        image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        if image is None:
            raise SourceError(f"{file} is no image")
        yield Shot(side, time, _grey(image))


def from_videos(paths: Sequence[str], frame_rate: float) -> Generator[Shot, None, None]:
    """Two videos that start together; frame k is at k / frame_rate, whatever the files say: players cannot show 900 frames a second."""
    with closing(_Captures(paths)) as captures:
        for k, images in enumerate(captures):
            for side, image in enumerate(images):
                yield Shot(side, k / frame_rate, image)


def from_devices(
    numbers: Sequence[str], now: Callable[[], float], params: DeviceParams, frame_rate: float, counts: DeviceCounts
) -> Generator[Shot, None, None]:
    """Two cameras that the operating system knows, stamped at the grab."""
    if not all(number.isdigit() for number in numbers):
        raise SourceError(f"devices are two numbers, got {list(numbers)}")
    for time, images in grabs([int(number) for number in numbers], now, params, frame_rate, counts):
        for side, image in enumerate(images):
            yield Shot(side, time, _grey(image))


class _Captures:
    """Frames of several captures taken together, until one ends."""

    def __init__(self, sources: Sequence[str]) -> None:
        self._captures = [cv2.VideoCapture(source) for source in sources]
        for source, capture in zip(sources, self._captures, strict=True):
            if not capture.isOpened():
                self.close()
                raise SourceError(f"cannot open {source!r}")

    def __iter__(self) -> Iterator[list[Image]]:
        while sum(capture.grab() for capture in self._captures) == len(self._captures):  # all are grabbed before any is decoded
            yield [_grey(capture.retrieve()[1]) for capture in self._captures]

    def close(self) -> None:
        for capture in self._captures:
            capture.release()


def from_bag(path: Path) -> Generator[Shot, None, None]:
    """Read the images on /camera/{left,right}/image_raw of a bag.

    Args:
        path: A bag of any kind that `tt_core.ros.bags` reads.

    Yields:
        Shots by the stamps of their messages.

    Raises:
        SourceError: If the bag has no images.
        BagError: If it cannot be read.
        BadMessage: If an image has an encoding that is not known.
    """
    from tt_core.ros.convert import image_from_message, seconds  # here, because no other source needs ROS

    count = 0
    for side, message in _messages(path, "image_raw"):
        image = image_from_message(message)
        native = image.astype(image.dtype.newbyteorder("="), copy=False)
        yield Shot(side, seconds(message.header.stamp), native)
        count += 1
    if not count:
        raise SourceError(f"no images on {' and '.join(f'camera/{side}/image_raw' for side in SIDES)} in {path}")


def calibrations(path: Path) -> dict[int, Calibration]:
    """Return what /camera/{left,right}/camera_info of a bag says, by side; a camera that is not calibrated (K[0] = 0) says nothing.

    Raises:
        TtError: a lens model that is not known, or a bag that cannot be read.
    """
    return {side: Calibration(*camera_from_message(m)) for side, m in _messages(path, "camera_info") if m.k[0] != 0.0}


def _messages(path: Path, kind: str) -> Iterator[tuple[int, Any]]:
    """Yield the index in SIDES and the message for each message on camera/{left,right}/{kind}."""
    with Bag(path) as bag:
        sides = {bag.find(f"camera/{name}/{kind}"): side for side, name in enumerate(SIDES)}
        for message in bag.messages([topic for topic in sides if topic] or ["none"]):
            yield sides[message.topic], bag.decode(message)


def _grey(image: np.ndarray) -> Image:
    if image.ndim == 3:
        image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    if image.dtype not in (np.uint8, np.uint16):
        raise SourceError(f"image of dtype uint8 or uint16 expected, got {image.dtype}")
    return image
