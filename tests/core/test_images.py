"""Every encoding that OpenCV knows becomes grey, rows padded or not; what does not fit is refused before anything is allocated."""

import numpy as np
import pytest
from refusals import refused
from tt_core.errors import BadMessage, OutOfRange, TtError
from tt_core.images import ENCODINGS, MOST_PIXELS, grey_image

HEIGHT, WIDTH, PADDING = 6, 8, 5
GREY = np.arange(HEIGHT * WIDTH, dtype=np.uint8).reshape(HEIGHT, WIDTH) * 5
COLOURS = ["rgb", "rgba", "bgr", "bgra"]


def encode(encoding, big_endian=False, padding=0):
    """The wanted grey image and the data of it, with `padding` bytes of 0xAA behind each row."""
    bits = 16 if encoding.endswith("16") or encoding.startswith("16") else 8
    grey = GREY.astype(np.uint16) * 257 if bits == 16 else GREY
    if encoding.startswith("bayer"):
        grey = np.full_like(grey, grey.max() // 3)  # the colours between the pixels are interpolated: even grey stays
    values = np.repeat(grey[..., None], ENCODINGS[encoding].channels, axis=2)
    if encoding in ("yuv422", "uyvy"):
        values[..., 0] = np.random.default_rng(0).integers(0, 256, grey.shape)
    if encoding in ("yuv422_yuy2", "yuyv"):
        values[..., 1] = np.random.default_rng(0).integers(0, 256, grey.shape)
    rows = values.astype(values.dtype.newbyteorder(">" if big_endian else "<")).reshape(HEIGHT, -1).view(np.uint8)
    rows = np.concatenate(
        [rows, np.random.default_rng(1).integers(0, 256, (int(HEIGHT * ENCODINGS[encoding].rows) - HEIGHT, rows.shape[1]))]
    )
    rows = np.pad(rows.astype(np.uint8), ((0, 0), (0, padding)), constant_values=0xAA)
    return grey, rows.shape[1], rows.tobytes()


@pytest.mark.parametrize("padding", [0, PADDING])
@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize("encoding", ENCODINGS)
def test_every_encoding_becomes_grey(encoding, big_endian, padding):
    grey, step, data = encode(encoding, big_endian, padding)
    image = grey_image(encoding, WIDTH, HEIGHT, step, data, big_endian=big_endian)
    assert image.dtype == grey.dtype and image.flags.c_contiguous
    assert (image == grey).all()


def test_colours_have_their_shares_of_brightness():
    colours = np.zeros((1, 3, 3), np.uint8)
    colours[0, range(3), range(3)] = 255
    shares = [76, 150, 29]  # of red, green and blue, ITU-R BT.601
    assert grey_image("rgb8", 3, 1, 9, colours.tobytes()).tolist() == [shares]
    assert grey_image("8UC3", 3, 1, 9, colours.tobytes()).tolist() == [shares[::-1]]


@pytest.mark.parametrize("encoding", ["mono8", "8UC1", "mono16"])
def test_grey_without_gaps_is_a_view(encoding):
    _, step, data = encode(encoding)
    data = bytearray(data)
    assert np.shares_memory(grey_image(encoding, WIDTH, HEIGHT, step, data), np.frombuffer(data, np.uint8))


@pytest.mark.parametrize("encoding", ["", "8SC1", "8UC2", "32FC1", "64FC4", "jpeg", "x" * 10**6])
def test_an_encoding_without_brightness_is_refused_by_name(encoding):
    with refused(BadMessage, "mono8") as error:
        grey_image(encoding, WIDTH, HEIGHT, WIDTH, bytes(WIDTH * HEIGHT))
    assert len(str(error.value)) < 1000


@pytest.mark.parametrize(
    ("width", "height", "step", "length", "error"),
    [
        (WIDTH, HEIGHT, WIDTH - 1, (WIDTH - 1) * HEIGHT, BadMessage),
        (WIDTH, HEIGHT, WIDTH, WIDTH * HEIGHT - 1, BadMessage),
        (WIDTH, HEIGHT, WIDTH, WIDTH * HEIGHT + 1, BadMessage),
        (WIDTH, HEIGHT, 0, 0, BadMessage),
        (WIDTH, HEIGHT, 2**32 - 1, WIDTH * HEIGHT, BadMessage),
        (0, HEIGHT, 0, 0, OutOfRange),
        (WIDTH, 0, WIDTH, 0, OutOfRange),
        (MOST_PIXELS + 1, 1, MOST_PIXELS + 1, MOST_PIXELS + 1, OutOfRange),
        (1, 2**32 - 1, 1, 1, OutOfRange),
    ],
)
def test_a_size_that_does_not_fit_is_refused(width, height, step, length, error):
    with pytest.raises(error):
        grey_image("mono8", width, height, step, bytes(length))


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("size", [(1, 1), (1, 2), (2, 1), (3, 3), (7, 5)])
def test_small_and_odd_images_are_read_or_refused(encoding, size):
    known = ENCODINGS[encoding]
    width, height = size
    step = width * known.channels * np.dtype(known.dtype).itemsize
    try:
        image = grey_image(encoding, width, height, step, bytes(step * int(height * known.rows)))
    except TtError:
        return
    assert image.shape == (height, width)
