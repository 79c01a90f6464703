"""Quality of service by the words of ros2cli."""

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

# messages that may wait: half a second of two cameras at 900 Hz
ALL = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
PROFILES = ("default", "sensor_data", "system_default", "services_default", "parameters", "parameter_events")


@dataclass(frozen=True)
class QosWords:
    """What the command line asks for; None and "" leave it to the profile, and without a profile to the other side of the topic."""

    preset: str = ""
    depth: int | None = None
    history: str = ""
    reliability: str = ""
    durability: str = ""
    liveliness: str = ""
    lease: float | None = None

    def profile(self, offered: Sequence[QoSProfile] = (), otherwise: QoSProfile = ALL) -> QoSProfile:
        """Return the profile.

        Args:
            offered: Of the publishers of the topic; a subscriber asks for no more than these where no word says otherwise.
            otherwise: What is asked for without words.
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
