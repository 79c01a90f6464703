"""A simulated world that replaces the hardware: launcher, ball, table, cameras and arm.

The names of `__all__` are what `tt_sim.render.render` takes. They are imported when they are first used, so that a node does not load
modules that it does not need. The function has the name of its module and is imported from there.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .render import Lamp, Lamps, Noise, Texture

__all__ = ["Lamp", "Lamps", "Noise", "Texture"]


def __getattr__(name: str) -> Any:
    """Import an exported name when it is first used."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(".render", __name__), name)
