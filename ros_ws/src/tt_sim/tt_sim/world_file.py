"""What is true in the simulator: physics, its randomization, cameras and arm. `worlds/` holds a YAML file for each world."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from tt_core.errors import check_range
from tt_core.physics import Physics
from tt_core.strict_yaml import build, find, read

from .cameras.camera_faults import CameraFaults
from .cameras.tracking_cameras import TrackingCameraFaults
from .domain_randomization import DomainRandomization
from .world.plant import PlantParams
from .world.true_ball import LEAST_CONTACT

WORLDS = Path(__file__).parent / "worlds"
_SESSIONS = 3  # second part of the seeds of sessions, which keeps them apart from those of balls


@dataclass(frozen=True)
class WorldParams:
    """What is true in the simulator.

    Attributes:
        physics: Models of air, table and rubber.
        session_randomization: How much their coefficients differ from session to session.
        domain_randomization: How much they differ from ball to ball in a session.
        cameras: Faults of the high-speed cameras.
        tracking_cameras: Faults of the wide cameras.
        plant: The arm.
        sensor_error_model: Name of a file of `tt_eval/sensor_error_models/`: errors of the measured ball where no images are rendered.
    """

    physics: Physics = field(default_factory=Physics.liu)
    session_randomization: DomainRandomization = field(default_factory=DomainRandomization)
    domain_randomization: DomainRandomization = field(default_factory=DomainRandomization)
    cameras: CameraFaults = field(default_factory=CameraFaults)
    tracking_cameras: TrackingCameraFaults = field(default_factory=TrackingCameraFaults)
    plant: PlantParams = field(default_factory=PlantParams)
    sensor_error_model: str = "clear"

    def __post_init__(self) -> None:
        """Refuse a ball that is a point, as in the dissertation's models: it cannot touch a racket's disc."""
        check_range("physics.contact_height", self.physics.contact_height, LEAST_CONTACT, 0.1)

    def of_session(self, number: int) -> WorldParams:
        """Return the world with the coefficients of one session; number: of the session, its seed."""
        rng = np.random.default_rng([number, _SESSIONS])
        return replace(self, physics=self.session_randomization.draw(self.physics, rng))


def load_world(name: str) -> WorldParams:
    """Read a world.

    Args:
        name: Of a file in `worlds/`, without suffix, or the path of another one.

    Raises:
        BadFile: It cannot be read, or something in it is wrong.
    """
    file = find(name, WORLDS)
    return build(WorldParams, read(file), file.name)
