"""Quality of service for each kind of data, see docs/interfaces.md."""

from collections.abc import Sequence

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

SENSOR = QoSProfile(depth=64, reliability=ReliabilityPolicy.BEST_EFFORT)  # images: room for all images of one ball
RECORDED = QoSProfile(depth=1000)  # images of a recording: none may be lost
RELIABLE = QoSProfile(depth=100)  # a recorder on a busy machine is 0.1 s behind
LATEST = QoSProfile(depth=1)  # only the newest matters
NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)  # the same, where an old one must never come late
TRUTH = QoSProfile(depth=1000)  # /sim/*: nothing may be lost in evaluation
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def compatible(wanted: QoSProfile, offered: Sequence[QoSProfile]) -> QoSProfile:
    """Return the wanted quality of service, reduced to what every publisher of a topic offers.

    DDS does not connect a subscriber that asks for more than the publisher offers.

    Args:
        wanted: Quality of service that is wanted.
        offered: Quality of service of each publisher of the topic.
    """
    best_effort = any(qos.reliability is ReliabilityPolicy.BEST_EFFORT for qos in offered)
    volatile = any(qos.durability is DurabilityPolicy.VOLATILE for qos in offered)
    return QoSProfile(
        depth=wanted.depth,
        reliability=ReliabilityPolicy.BEST_EFFORT if best_effort else wanted.reliability,
        durability=DurabilityPolicy.VOLATILE if volatile else wanted.durability,
    )
