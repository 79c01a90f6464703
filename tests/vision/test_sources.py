"""The same images come out of every kind of source, in the order of time."""

import cv2
import numpy as np
import pytest
from bagforms import FORMS, TYPES
from tt_core.errors import BadChoice
from tt_core.ros.bags import BagError
from tt_vision.capture.devices import DeviceCounts, DeviceParams
from tt_vision.capture.sources import (
    CannotOpen,
    NoImages,
    NotDeviceNumbers,
    SourceParams,
    calibrations,
    from_bag,
    from_devices,
    from_folder,
    from_videos,
    read_images,
)


@pytest.fixture
def images():
    """[frame][side]"""
    return np.random.default_rng(0).integers(0, 255, (3, 2, 24, 32)).astype(np.uint8)


def check(taken, images, times):
    taken = list(taken)
    assert [shot.side for shot in taken] == [0, 1] * len(images)
    assert [shot.time for shot in taken[::2]] == pytest.approx(times, abs=1e-7)
    for shot, image in zip(taken, images.reshape(-1, *images.shape[2:]), strict=True):
        assert shot.image.dtype == image.dtype and (shot.image == image).all()


@pytest.mark.parametrize("name", ["{side}_{nano}.png", "{side}/{nano}.png", "{side}-{seconds:.6f}.pgm"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_folder(tmp_path, images, name, dtype):
    images = images.astype(dtype) * (1 if dtype == np.uint8 else 4)
    nano = [1_700_000_000_000_000_000 + 1_111_111 * k for k in range(3)] if "nano" in name else [0, 10**6, 2 * 10**6]
    for k, pair in enumerate(images):
        for side, image in zip(("left", "right"), pair, strict=True):
            file = tmp_path / name.format(side=side, nano=nano[k], seconds=nano[k] * 1e-9)
            file.parent.mkdir(exist_ok=True)
            cv2.imwrite(str(file), image)
    (tmp_path / "notes.txt").write_text("not an image")
    check(from_folder(tmp_path), images, np.array(nano) * 1e-9)


def test_videos(tmp_path, images):
    smooth = np.repeat(images[:, :, :1, :1], 32, axis=2).repeat(32, axis=3)  # one grey each: no codec changes it much
    files = [str(tmp_path / f"{side}.avi") for side in ("left", "right")]
    for side, file in enumerate(files):
        writer = cv2.VideoWriter(file, cv2.VideoWriter_fourcc(*"MJPG"), 30.0, (32, 32), False)
        for pair in smooth:
            writer.write(pair[side])
        writer.release()
    taken = list(from_videos(files, 900.0))
    assert [shot.time for shot in taken] == pytest.approx(np.repeat(np.arange(3) / 900.0, 2))
    for shot, image in zip(taken, smooth.reshape(-1, 32, 32), strict=True):
        assert np.abs(shot.image.astype(int) - image).max() <= 3  # grey levels, the codec's


@pytest.mark.parametrize("form", FORMS)
def test_a_bag(tmp_path, images, form):
    types = TYPES.types
    header, stamp = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    region = types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    k, d = np.array([1750.0, 0, 15.5, 0, 1750.0, 11.5, 0, 0, 1]), np.zeros(5)
    info = types["sensor_msgs/msg/CameraInfo"](
        header(stamp(0, 0), ""), 24, 32, "plumb_bob", d, k, np.eye(3).ravel(), np.zeros(12), 0, 0, region
    )
    rows = [("/camera/left/camera_info", "sensor_msgs/msg/CameraInfo", 0, info)]
    for n, pair in enumerate(images):
        for side, image in zip(("left", "right"), pair, strict=True):
            message = types["sensor_msgs/msg/Image"](header(stamp(5, n * 10**6), ""), 24, 32, "mono8", 0, 32, image.ravel())
            rows.append((f"/camera/{side}/image_raw", "sensor_msgs/msg/Image", n * 10**6, message))
    bag = FORMS[form](tmp_path, rows)
    check(from_bag(bag), images, [5.0, 5.001, 5.002])
    check(read_images(SourceParams("bag", str(bag)), float), images, [5.0, 5.001, 5.002])
    (calibration,) = calibrations(bag).values()
    assert (calibration.width, calibration.height) == (32, 24)
    assert calibration.matrix == pytest.approx(k.reshape(3, 3))


def test_what_cannot_be_opened_says_so(tmp_path):
    with pytest.raises(NoImages):
        next(from_folder(tmp_path))
    with pytest.raises(BagError):
        next(from_bag(tmp_path / "nothing"))
    with pytest.raises(CannotOpen):
        next(from_videos([str(tmp_path / "a.avi"), str(tmp_path / "b.avi")], 900.0))
    with pytest.raises(NotDeviceNumbers):
        next(from_devices(["left", "right"], float, DeviceParams(), 900.0, DeviceCounts()))
    with pytest.raises(BadChoice):
        SourceParams("film")
