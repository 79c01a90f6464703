"""Worlds: what is true in the simulator, i.e. physics, its randomization, faults of the cameras, and the arm.

The folder `worlds/` holds a YAML file for each world.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from tt_core.errors import check_range
from tt_core.physics import Physics
from tt_core.strict_yaml import build, find_file, read_yaml

from .cameras.camera_faults import CameraFaults
from .cameras.tracking_cameras import TrackingCameraFaults
from .domain_randomization import DomainRandomization
from .world.plant import PlantParams
from .world.true_ball import LEAST_CONTACT

WORLDS = Path(__file__).parent / "worlds"
_SESSIONS = 3  # second part of the seeds of sessions, which makes them differ from the seeds of balls


@dataclass(frozen=True)
class WorldParams:
    """A world: what is true in the simulator.

    Attributes:
        physics: Models of air, table and rubber.
        session_randomization: Random differences of their coefficients from session to session.
        domain_randomization: Random differences of their coefficients from ball to ball in a session.
        cameras: Faults of the high-speed cameras.
        tracking_cameras: Faults of the wide cameras.
        plant: The simulated arm.
        sensor_error_model: Name of a file in `tt_eval/sensor_error_models/`: errors of the measured ball if no images are rendered.
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
        """Return the world with the coefficients of one session, which are drawn at random.

        Args:
            number: Number of the session, used as the seed.
        """
        rng = np.random.default_rng([number, _SESSIONS])
        return replace(self, physics=self.session_randomization.draw(self.physics, rng))


def load_world(name: str) -> WorldParams:
    """Read a world from its file.

    Args:
        name: Name of a file in `worlds/`, without suffix, or the path of another one.

    Raises:
        BadFile: The file cannot be read, or a value in it is wrong.
    """
    file = find_file(name, WORLDS)
    return build(WorldParams, read_yaml(file), file.name)
