"""Publishes the images of two 900 Hz cameras, 97 MB/s, for SECONDS, and prints how many it sent. Started by `scripts/bench record`."""

import struct
import sys
import time

import numpy as np
import rclpy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Image
from tt_core.ros.convert import image_to_message
from tt_core.ros.qos import SENSOR

RATE, SIZE = 900.0, 232  # 1/s of each camera, pixels
TOPICS = ("/stream/left/image_raw", "/stream/right/image_raw")
STAMP = struct.Struct("<iI")  # seconds and nanoseconds, behind the 4 bytes of the CDR header


def main(seconds: float) -> None:
    rclpy.init()
    node = rclpy.create_node("camera_stream", enable_rosout=False)
    publishers = [node.create_publisher(Image, topic, SENSOR) for topic in TOPICS]
    noise = np.random.default_rng(0).integers(0, 30, (SIZE, SIZE), np.uint8)
    data = bytearray(serialize_message(image_to_message(noise, 1.0, "camera")))
    while not all(publisher.get_subscription_count() for publisher in publishers):
        time.sleep(0.05)
    time.sleep(1.0)  # until the subscriptions know the publishers, too
    sent, begin = 0, time.monotonic()
    while (now := time.monotonic() - begin) < seconds:
        if now < sent / RATE:
            time.sleep(sent / RATE - now)
            continue
        STAMP.pack_into(data, 4, *divmod(time.time_ns(), 10**9))
        for publisher in publishers:
            publisher.publish(bytes(data))
        sent += 1
    print(sent, f"{time.process_time():.3f}", flush=True)
    sys.stdin.readline()  # stay until the recorder has taken the last one
    rclpy.try_shutdown()


if __name__ == "__main__":
    main(float(sys.argv[1]))
