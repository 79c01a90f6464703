"""Simulation of whole rallies without ROS, and evaluation of their results.

The names of `__all__` are imported when they are first used. The function `tt_eval.sweep.sweep` has the name of its module and is imported
from there.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .episode import Episode, Trial, landing_error, play, session, spin_error
    from .failures import EpisodeFailure
    from .miss import Miss
    from .page import Section, Table, html_page
    from .scenario import Robot, Scenario, load
    from .sensor_error_model import SensorErrorModel, last_frame
    from .synthetic_bursts import BurstConditions, SyntheticBurst, bursts
    from .video_scoring import score_from_video

__all__ = [
    "BurstConditions",
    "Episode",
    "EpisodeFailure",
    "Miss",
    "Robot",
    "Scenario",
    "Section",
    "SensorErrorModel",
    "SyntheticBurst",
    "Table",
    "Trial",
    "bursts",
    "html_page",
    "landing_error",
    "last_frame",
    "load",
    "play",
    "score_from_video",
    "session",
    "spin_error",
]

_MODULES = {
    "episode": (
        "Episode",
        "Trial",
        "landing_error",
        "play",
        "session",
        "spin_error",
    ),
    "failures": ("EpisodeFailure",),
    "miss": ("Miss",),
    "page": (
        "Section",
        "Table",
        "html_page",
    ),
    "scenario": (
        "Robot",
        "Scenario",
        "load",
    ),
    "sensor_error_model": (
        "SensorErrorModel",
        "last_frame",
    ),
    "synthetic_bursts": (
        "BurstConditions",
        "SyntheticBurst",
        "bursts",
    ),
    "video_scoring": ("score_from_video",),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import an exported name when it is first used."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_MODULE_OF[name]}", __name__), name)
