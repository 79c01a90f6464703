"""Shared vocabulary of all packages: states of ball and racket, physics, errors, and their conversion to messages.

The names of `__all__` are imported when they are first used, because `tt_core.start` must run before all slow imports of a node.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .bounce import RacketRebound, TableRebound
    from .errors import TtError
    from .failures import Failure
    from .flight import Aerodynamics
    from .path_end import PathEnd
    from .physics import Physics
    from .states import BallPath, BallState, Bounce, RacketState, ReturnGoal

__all__ = [
    "Aerodynamics",
    "BallPath",
    "BallState",
    "Bounce",
    "Failure",
    "PathEnd",
    "Physics",
    "RacketRebound",
    "RacketState",
    "ReturnGoal",
    "TableRebound",
    "TtError",
]

_MODULES = {
    "bounce": ("RacketRebound", "TableRebound"),
    "errors": ("TtError",),
    "failures": ("Failure",),
    "flight": ("Aerodynamics",),
    "path_end": ("PathEnd",),
    "physics": ("Physics",),
    "states": ("BallPath", "BallState", "Bounce", "RacketState", "ReturnGoal"),
}


def __getattr__(name: str) -> Any:
    """Import a name of `__all__` when it is first used."""
    for module, names in _MODULES.items():
        if name in names:
            return getattr(import_module(f".{module}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
