"""The rotation machine of dissertation Section 2.5.1, which holds a ball and rotates it about one of two axes."""

from __future__ import annotations

import numpy as np
from tt_core.constants import RPM
from tt_core.flight import Aerodynamics
from tt_core.states import BallState
from tt_vision.rig import VIEW_CENTRE

AXES = ((-0.038, 0.999, -0.006), (-0.557, 0.814, 0.165))  # Section 2.5.1; the frame is not stated, in the scenario `table`
SPEEDS = (1500, 2000, 2500, 3000)  # rpm
NO_AIR_OR_GRAVITY = Aerodynamics(drag=0.0, drag_h=0.0, lift=0.0, lift_h=0.0, gravity=0.0)  # of a ball that is held: it keeps place and spin


def rotating_ball(number: int) -> BallState:
    """Return the ball of a trial, at rest at the centre of the cameras' view, with time 0.

    The axes of rotation alternate. After both axes comes the next speed.

    Args:
        number: Number of the trial, from 0.
    """
    axis, speed = AXES[number % len(AXES)], SPEEDS[number // len(AXES) % len(SPEEDS)]
    return BallState(0.0, np.array(VIEW_CENTRE), np.zeros(3), speed * RPM * np.array(axis) / np.linalg.norm(axis))
