"""Planning and control of an arm that brings its racket to a wanted state (dissertation Section 4.5, Appendix B).

A stroke is the racket's position, orientation and velocity at one time that returns the ball. A swing is the joint motion that makes a
stroke. A module is loaded when one of its names is used, so that a program that needs only the model does not load the planner. The
function `tt_arm.reach.reach` has the same name as its module; import it from there. The dissertation is the Nagoya dissertation "Racket
Control and Spinning Ball Measurement for Table Tennis Robot".
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .joints import Joints
    from .model import ArmModel
    from .reach import Reach, ReachFailure
    from .swing import Swing, SwingFailure, SwingLimits, plan

__all__ = ["ArmModel", "Joints", "Reach", "ReachFailure", "Swing", "SwingFailure", "SwingLimits", "plan"]

_MODULES = {
    "ArmModel": "model", "Joints": "joints", "Reach": "reach", "ReachFailure": "reach", "Swing": "swing", "SwingFailure": "swing",
    "SwingLimits": "swing", "plan": "swing",
}  # fmt: skip


def __getattr__(name: str) -> Any:
    """Load the module that has an exported name, and return the object of this name."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_MODULES[name]}", __name__), name)
