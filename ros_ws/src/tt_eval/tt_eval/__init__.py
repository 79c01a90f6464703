"""Simulation of whole rallies without ROS, and evaluation of their results.

The names of `__all__` are imported when they are first used. The function `tt_eval.sweep.sweep` has the name of its module and is imported
from there.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .episode import Episode, play
    from .failures import EpisodeFailure
    from .scenario import Scenario, load

__all__ = ["Episode", "EpisodeFailure", "Scenario", "load", "play"]

_MODULES = {"Episode": "episode", "EpisodeFailure": "failures", "Scenario": "scenario", "load": "scenario", "play": "episode"}


def __getattr__(name: str) -> Any:
    """Import an exported name when it is first used."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_MODULES[name]}", __name__), name)
