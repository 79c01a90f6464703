"""Joint velocity commands that keep the arm on its path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from tt_core.params import check, param
from tt_core.states import Array

from .swing import Swing


@dataclass(frozen=True, slots=True)
class ServoParams:
    """Feed-forward and feedback."""

    gain: float = param(15.0, "1/s", "of the position error; well below 1 / (4 lead), where the loop begins to ring", low=0.0, high=1000.0)
    lead: float = param(
        0.006, "s", "the plant's lag (5 ms) and half of a tick of 2 ms, after which a command takes effect", low=0.0, high=0.1
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


def follow(swing: Swing, time: float, q: Array, speed_limits: Array, params: ServoParams) -> Array:
    """The command (7,) rad/s at `time` (s) for joints at q (7,) rad: the path's speed `lead` ahead plus gain times the position error."""
    q_path, _ = swing.sample(time)
    _, qdot_ahead = swing.sample(time + params.lead)
    return np.clip(qdot_ahead + params.gain * (q_path - q), -speed_limits, speed_limits)
