"""A folder of images in, both cameras' topics out."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from nav_msgs.msg import Odometry
from refusals import check_named
from sensor_msgs.msg import CameraInfo, Image
from tt_core.ros.bags import Bag
from tt_core.ros.convert import camera_from_message, image_from_message, seconds
from tt_core.ros.qos import LATCHED, RECORDED, SENSOR
from tt_vision.rig import high_speed_pair

REFERENCE = Path(__file__).parents[2] / "bags" / "reference_back_5"


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
    probe.create_subscription(CameraInfo, "/camera/right/camera_info", lambda _: None, LATCHED)
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
    assert node.wait(timeout=120) == 2
    check_named(node.stderr.read(), tmp_path)


@pytest.mark.parametrize("first", ["camera", "estimate"])
def test_a_recording_is_measured_whoever_starts_first(start, probe, until, tmp_path, first):
    """Every image arrives, the ball is measured, and the camera node ends by itself."""
    with Bag(REFERENCE) as bag:
        for side in ("left", "right"):
            for message in bag.messages([f"/camera/{side}/image_raw"]):
                image = bag.decode(message)
                cv2.imwrite(str(tmp_path / f"{side}_{seconds(image.header.stamp):.9f}.png"), image_from_message(image))
    balls, images = [], []
    options = ("--ros-args", "-p", f"path:={tmp_path}", "-p", "end:=true", "-p", "linger:=1.0", "-p", "speed:=0.0")
    starts = {"camera": ("tt_vision.camera_node", *options), "estimate": ("tt_vision.estimate_node",)}
    started = {first: start(*starts.pop(first))}
    until(lambda: first in probe.get_node_names(), probe)
    probe.create_subscription(Odometry, "/ball/measured", balls.append, 10)
    for side in ("left", "right"):
        probe.create_subscription(Image, f"/camera/{side}/image_raw", images.append, RECORDED)
    started |= {name: start(*words) for name, words in starts.items()}
    until(lambda: started["camera"].poll() is not None, probe, 200.0)
    assert started["camera"].returncode == 0
    until(lambda: balls and len(images) == 48, probe)
    assert len(balls) == 1
