"""Quality-of-service profiles from the options of the command line, which are those of ros2cli."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    QoSDurabilityPolicy,
    QoSHistoryPolicy,
    QoSLivelinessPolicy,
    QoSPresetProfiles,
    QoSProfile,
    QoSReliabilityPolicy,
    ReliabilityPolicy,
)
from tt_core.ros.qos import compatible

# the queue of 1000 messages holds half a second of two cameras at 900 Hz
KEEP_ALL = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
QOS_PROFILES = ("default", "sensor_data", "system_default", "services_default", "parameters", "parameter_events")


@dataclass(frozen=True)
class QosWords:
    """Quality-of-service options of the command line. An option that is None or "" was not given; `profile` tells what replaces it.

    Attributes:
        preset: Name of a preset profile, one of QOS_PROFILES.
        depth: Number of messages in the queue.
        history: Name of the history policy, e.g. "keep_last".
        reliability: Name of the reliability policy, e.g. "best_effort".
        durability: Name of the durability policy, e.g. "transient_local".
        liveliness: Name of the liveliness policy, e.g. "automatic".
        lease: Lease duration of the liveliness, s.
    """

    preset: str = ""
    depth: int | None = None
    history: str = ""
    reliability: str = ""
    durability: str = ""
    liveliness: str = ""
    lease: float | None = None

    def profile(self, offered: Sequence[QoSProfile] = (), otherwise: QoSProfile = KEEP_ALL) -> QoSProfile:
        """Return the profile that the options ask for. Options that were not given are taken from a base profile.

        The base is the preset profile. Without a preset it is `otherwise`, lowered to the reliability and durability that all publishers
        offer, because a subscriber that asks for more receives nothing.

        Args:
            offered: Profiles of the topic's publishers.
            otherwise: Base profile without a preset.
        """
        found = QoSPresetProfiles.get_from_short_key(self.preset) if self.preset else compatible(otherwise, offered)
        return QoSProfile(
            depth=found.depth if self.depth is None else self.depth,
            history=QoSHistoryPolicy.get_from_short_key(self.history) if self.history else found.history,
            reliability=QoSReliabilityPolicy.get_from_short_key(self.reliability) if self.reliability else found.reliability,
            durability=QoSDurabilityPolicy.get_from_short_key(self.durability) if self.durability else found.durability,
            liveliness=QoSLivelinessPolicy.get_from_short_key(self.liveliness) if self.liveliness else found.liveliness,
            liveliness_lease_duration=found.liveliness_lease_duration if self.lease is None else Duration(seconds=self.lease),
        )
