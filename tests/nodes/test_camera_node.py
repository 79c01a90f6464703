"""A folder of images in, both cameras' topics out."""

import cv2
import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, Image
from tt_core.ros.convert import camera_from_message, image_from_message, seconds
from tt_core.ros.qos import LATCHED, SENSOR
from tt_vision.rig import high_speed_pair


@pytest.fixture
def folder(tmp_path):
    images = np.random.default_rng(0).integers(0, 255, (4, 2, 232, 232)).astype(np.uint8)
    for k, pair in enumerate(images):
        for side, image in zip(("left", "right"), pair, strict=True):
            cv2.imwrite(str(tmp_path / f"{side}_{10 + 0.001 * k:.6f}.png"), image)
    return tmp_path, images


def test_a_folder_is_published(start, probe, until, folder):
    path, images = folder
    got = {"left": [], "right": []}
    infos = []
    for name, messages in got.items():
        probe.create_subscription(Image, f"/camera/{name}/image_raw", messages.append, SENSOR)
    probe.create_subscription(CameraInfo, "/camera/left/camera_info", infos.append, LATCHED)
    start("tt_vision.camera_node", "--ros-args", "-p", "kind:=folder", "-p", f"path:={path}", "-p", "speed:=0.05")
    until(lambda: infos and all(len(messages) == 4 for messages in got.values()), probe)
    for side, name in enumerate(got):
        for k, message in enumerate(got[name]):
            assert (image_from_message(message) == images[k, side]).all()
            assert seconds(message.header.stamp) == pytest.approx(10 + 0.001 * k)
            assert message.header.frame_id == f"{name}_optical"
    width, height, matrix, _ = camera_from_message(infos[0])
    assert (width, height) == (232, 232)
    assert matrix == pytest.approx(high_speed_pair()[0].matrix)


def test_a_source_that_is_not_there_ends_it_with_the_reason(start, tmp_path):
    node = start("tt_vision.camera_node", "--ros-args", "-p", f"path:={tmp_path}")
    assert node.wait(timeout=30) == 2
    assert "no images named" in node.stderr.read()
