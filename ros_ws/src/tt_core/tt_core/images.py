"""Conversion of images to grey, for the encodings of sensor_msgs/image_encodings."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, NamedTuple

import cv2
import numpy as np

from .errors import BadMessage, MessageFailure, check_range

MOST_PIXELS = 8192  # in width or height: twice the largest industrial cameras of today
LUMA_UYVY, LUMA_YUYV = 1, 0  # which of the two bytes of a pixel is the brightness


class Encoding(NamedTuple):
    """Layout of the data of an image.

    Attributes:
        dtype: Type of one value.
        channels: Number of values of a pixel.
        grey: Function that makes a grey image (h, w) of values (h, w, channels), or (h, w) if there is one channel. None if the values
            already are grey.
        rows: Rows of the data for each row of the image. Above 1 the planes of colour follow the plane of brightness.
    """

    dtype: type[np.uint8] | type[np.uint16]
    channels: int
    grey: Callable[[np.ndarray], np.ndarray] | None = None
    rows: float = 1.0


def _opencv(code: int) -> Callable[[np.ndarray], np.ndarray]:
    """Return the conversion of OpenCV with that code."""
    return lambda values: cv2.cvtColor(np.ascontiguousarray(values), code)


def _encodings() -> dict[str, Encoding]:
    """Return all encodings that are read, by their names in ROS."""
    found: dict[str, Encoding] = {}
    codes = {"rgb": cv2.COLOR_RGB2GRAY, "rgba": cv2.COLOR_RGBA2GRAY, "bgr": cv2.COLOR_BGR2GRAY, "bgra": cv2.COLOR_BGRA2GRAY}
    for bits, dtype in ((8, np.uint8), (16, np.uint16)):
        found[f"mono{bits}"] = found[f"{bits}UC1"] = Encoding(dtype, 1)
        found |= {f"{name}{bits}": Encoding(dtype, len(name), _opencv(code)) for name, code in codes.items()}
        found[f"{bits}UC3"], found[f"{bits}UC4"] = found[f"bgr{bits}"], found[f"bgra{bits}"]  # no colours are named: OpenCV's order
        for pattern in ("rggb", "bggr", "gbrg", "grbg"):
            found[f"bayer_{pattern}{bits}"] = Encoding(dtype, 1, _opencv(getattr(cv2, f"COLOR_Bayer{pattern.upper()}2GRAY")))
    found["yuv422"] = found["uyvy"] = Encoding(np.uint8, 2, lambda values: values[..., LUMA_UYVY])
    found["yuv422_yuy2"] = found["yuyv"] = Encoding(np.uint8, 2, lambda values: values[..., LUMA_YUYV])
    found["nv21"], found["nv24"] = Encoding(np.uint8, 1, rows=1.5), Encoding(np.uint8, 1, rows=3.0)
    return found


ENCODINGS = _encodings()


def grey_image(encoding: str, width: int, height: int, step: int, data: Any, *, big_endian: bool = False) -> np.ndarray:
    """Read the data of an image message as a grey image.

    Args:
        encoding: One of ENCODINGS.
        width: Pixels.
        height: Pixels.
        step: Bytes from the start of one row to the start of the next, with padding.
        data: Bytes, or an object with their buffer.
        big_endian: Whether the values of 16 bits have their high byte first.

    Returns:
        (height, width) uint8 or uint16, contiguous. It is a view of `data` where the data are grey, without padding, and in the byte order
        of this machine.

    Raises:
        BadMessage: The encoding is unknown, the step is too small, or the data have another length.
        OutOfRange: A size is outside 1 to MOST_PIXELS.
    """
    known = ENCODINGS.get(encoding)
    if known is None:
        raise BadMessage(MessageFailure.OTHER_ENCODING, encoding=encoding[:40], known=", ".join(ENCODINGS))
    check_range("image width, pixels,", width, 1, MOST_PIXELS)
    check_range("image height, pixels,", height, 1, MOST_PIXELS)
    dtype = np.dtype(known.dtype)
    pixel = known.channels * dtype.itemsize
    if step < width * pixel:
        raise BadMessage(MessageFailure.SMALL_STEP, step=step, width=width, encoding=encoding, needed=width * pixel)
    needed = step * int(height * known.rows)
    if len(data) != needed:
        size = {"size": len(data), "needed": needed, "step": step, "width": width, "height": height}
        raise BadMessage(MessageFailure.OTHER_LENGTH, encoding=encoding, **size)
    shape, strides = (height, width, known.channels), (step, pixel, dtype.itemsize)
    axes = 3 if known.channels > 1 else 2
    if big_endian != (sys.byteorder == "big"):
        dtype = dtype.newbyteorder()
    values = np.ndarray(shape[:axes], dtype, data, strides=strides[:axes]).astype(known.dtype, copy=False)
    return np.ascontiguousarray(known.grey(values) if known.grey else values)
