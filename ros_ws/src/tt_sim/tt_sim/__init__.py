"""A simulated world that replaces the hardware: launcher, ball, table, cameras and arm.

The names of `__all__` are imported when they are first used, so that a node does not load modules that it does not need. The function
`tt_sim.render.render` has the name of its module and is imported from there.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .cameras.camera_faults import CameraFaults
    from .cameras.tracking_cameras import Sightings, TrackingCameraFaults
    from .domain_randomization import DomainRandomization
    from .render import Lamp, Lamps, Noise, Scene, Texture
    from .simulated_robot import SimulatedRobot, Tick
    from .world.arm_record import ArmRecord
    from .world.launcher import LauncherParams, launch
    from .world.outcome import Outcome, Result
    from .world.plant import Plant, PlantParams
    from .world.racket_motion import RacketMotion
    from .world.surfaces import Surface
    from .world.true_ball import Contact, World
    from .world_file import WorldParams, load_world

__all__ = [
    "ArmRecord",
    "CameraFaults",
    "Contact",
    "DomainRandomization",
    "Lamp",
    "Lamps",
    "LauncherParams",
    "Noise",
    "Outcome",
    "Plant",
    "PlantParams",
    "RacketMotion",
    "Result",
    "Scene",
    "Sightings",
    "SimulatedRobot",
    "Surface",
    "Texture",
    "Tick",
    "TrackingCameraFaults",
    "World",
    "WorldParams",
    "launch",
    "load_world",
]

_MODULES = {
    "cameras.camera_faults": ("CameraFaults",),
    "cameras.tracking_cameras": (
        "Sightings",
        "TrackingCameraFaults",
    ),
    "domain_randomization": ("DomainRandomization",),
    "render": (
        "Lamp",
        "Lamps",
        "Noise",
        "Scene",
        "Texture",
    ),
    "simulated_robot": (
        "SimulatedRobot",
        "Tick",
    ),
    "world.arm_record": ("ArmRecord",),
    "world.launcher": (
        "LauncherParams",
        "launch",
    ),
    "world.outcome": (
        "Outcome",
        "Result",
    ),
    "world.plant": (
        "Plant",
        "PlantParams",
    ),
    "world.racket_motion": ("RacketMotion",),
    "world.surfaces": ("Surface",),
    "world.true_ball": (
        "Contact",
        "World",
    ),
    "world_file": (
        "WorldParams",
        "load_world",
    ),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import an exported name when it is first used."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_MODULE_OF[name]}", __name__), name)
