"""Quality of service by kind of data (DESIGN: topics)."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

SENSOR = QoSProfile(depth=64, reliability=ReliabilityPolicy.BEST_EFFORT)  # images: one burst of a ball fits
RELIABLE = QoSProfile(depth=100)  # a recorder on a busy machine is 0.1 s behind
LATEST = QoSProfile(depth=1)  # only the newest matters
NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)  # the same, where an old one must never come late
TRUTH = QoSProfile(depth=1000)  # /sim/*: nothing may be lost in evaluation
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
