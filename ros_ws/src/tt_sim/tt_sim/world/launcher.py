"""The machine that launches balls at the opponent's end, a catapult (dissertation Section 2.5.2, Tables 3.1 and 3.3).

A shot has a kind, which is the direction of its spin, and a scale, a setting of the machine that raises speed and spin. The tables have
scales 3 to 5. Scales 1, 2 and 6 to 10 are extrapolated, not measured: forward speed and spin are continued along a straight line, the
scatter is that of the nearest row, and the upward speed is chosen so that the mean ball lands at LANDING_X. This gives up to 13.6 m/s and
6,240 rpm, which is within what opponents play (9,129 rpm at most). Scale 1 is a lob of 5 to 6 m/s: at its low forward speed, only a high
ball reaches the robot in one bounce.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation
from tt_core.errors import BadChoice, TtError, check_range
from tt_core.events import next_contact
from tt_core.params import check, param
from tt_core.physics import Physics
from tt_core.states import Array, BallState

SHOT_KINDS = ("top", "back", "left", "right")
MIXED = "mixed"  # kind of a shot that is one of SHOT_KINDS at random
SCALES = (1, 10)  # least and largest scale
RATES = (26.0, 94.0)  # balls per minute, least and largest rate of the machine
LANDING_X = 0.5  # m, x in `table` where the mean ball of an extrapolated scale lands

# kind -> scale -> v_x, v_z (m/s) and spin (rad/s), each with its scatter: Tables 3.1 and 3.3.
# Side spin is not printed: about the mean of both.
_TABLE = {
    "top": {
        3: ((-4.99, 0.09), (2.53, 0.082), (300.0, 10.0)),
        4: ((-6.22, 0.11), (1.07, 0.15), (360.0, 23.0)),
        5: ((-7.46, 0.076), (1.68, 0.087), (400.0, 3.5)),
    },
    "back": {
        3: ((-5.1, 0.077), (1.47, 0.10), (270.0, 21.0)),
        4: ((-6.7, 0.048), (0.41, 0.11), (323.0, 37.0)),
        5: ((-7.4, 0.051), (-0.17, 0.14), (361.0, 21.0)),
    },
    "side": {
        3: ((-5.05, 0.08), (2.0, 0.09), (285.0, 15.0)),
        4: ((-6.46, 0.08), (0.74, 0.13), (340.0, 30.0)),
        5: ((-7.43, 0.06), (0.75, 0.11), (380.0, 12.0)),
    },
}
_AXES = {"top": (0.0, -1.0, 0.0), "back": (0.0, 1.0, 0.0), "left": (0.0, 0.0, -1.0), "right": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class LauncherParams:
    """Place and direction of the machine that launches balls, its rate, and its scatter besides that of the dissertation's tables."""

    x: float = param(2.62, "m", "x of the exit of the launcher's head", low=1.5, high=5.0)
    y: float = param(0.7625, "m", "y of the exit of the launcher's head; the middle of the table", low=0.0, high=1.525)
    z: float = param(0.34, "m", "z of the exit of the launcher's head; back spin at scale 5 clears the net from there", low=0.05, high=1.5)
    side_yaw: float = param(
        0.05,
        "rad",
        "angle by which the head is turned against the drift of side spin, half of it; at 0.03 and 0.07 the arm has no time for some balls",
        low=-0.5,
        high=0.5,
    )
    axis_scatter: float = param(
        0.05,
        "rad",
        "standard deviation of the spin axis about each coordinate axis; dissertation Tables 2.1 to 2.3 show about 0.1",
        low=0.0,
        high=0.5,
    )
    yaw_scatter: float = param(0.01, "rad", "standard deviation of the horizontal direction of the launch", low=0.0, high=0.5)
    place_scatter: float = param(0.002, "m", "standard deviation of each coordinate of the place of the launch", low=0.0, high=0.5)
    rate: float = param(
        0.0,
        "1/min",
        "balls launched in a minute, 26 to 94 as the machine of dissertation Section 2.5.2; 0: on request only",
        low=0.0,
        high=RATES[1],
        dynamic=True,
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range; the rate is 0 or one that the machine has."""
        if self.rate:
            check_range("rate", self.rate, *RATES)
        check(self)


Row = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]


@functools.cache
def shot_row(kind: str, scale: int, height: float = LauncherParams.z) -> Row:
    """Return mean and standard deviation of v_x (m/s), of v_z (m/s) and of the spin (rad/s) of a shot.

    Args:
        kind: One of SHOT_KINDS.
        scale: Whole number within SCALES.
        height: m, z of the launch, for the scales that are not in the tables.

    Raises:
        BadChoice: There is no such kind.
        OutOfRange: There is no such scale.
        TtError: The scale is not a whole number.
    """
    if kind not in SHOT_KINDS:
        raise BadChoice("kind", kind, SHOT_KINDS)
    if scale != int(check_range("scale", scale, *SCALES)):
        raise TtError(f"scale = {scale} is not a whole number")
    rows = _TABLE.get(kind, _TABLE["side"])
    if scale in rows:
        return rows[scale]
    nearest = rows[min(rows, key=lambda known: abs(known - scale))]
    v_x, spin = (float(np.polyval(np.polyfit(list(rows), [r[k][0] for r in rows.values()], 1), scale)) for k in (0, 2))
    low, high = -5.0, 6.0  # m/s, raised until the ball lands there; further up it lands further on
    for _ in range(40):
        v_z = 0.5 * (low + high)
        place, velocity = np.array([LauncherParams.x, LauncherParams.y, height]), np.array([v_x, 0.0, v_z])
        ball = BallState(0.0, place, velocity, spin * np.array(_AXES[kind]))
        contact = next_contact(ball, Physics.liu())
        low, high = (v_z, high) if contact.position[0] > LANDING_X else (low, v_z)
    return (v_x, nearest[0][1]), (high, nearest[1][1]), (spin, nearest[2][1])


def launch(kind: str, scale: int, params: LauncherParams, rng: np.random.Generator) -> tuple[BallState, Array]:
    """Draw a launched ball at random.

    Args:
        kind: One of SHOT_KINDS, or MIXED.
        scale: Whole number within SCALES.
        params: Parameters of the machine.
        rng: Random numbers for all that scatters.

    Returns:
        The ball at its launch, with time 0, and its orientation: (3, 3) from the ball's frame to `table`, evenly distributed.

    Raises:
        BadChoice: There is no such kind.
        OutOfRange: There is no such scale.
    """
    if kind == MIXED:
        kind = SHOT_KINDS[rng.integers(len(SHOT_KINDS))]
    v_x, v_z, spin = (rng.normal(mean, sigma) for mean, sigma in shot_row(kind, scale, params.z))
    yaw = rng.normal({"left": params.side_yaw, "right": -params.side_yaw}.get(kind, 0.0), params.yaw_scatter)
    velocity = np.array([v_x * math.cos(yaw), v_x * math.sin(yaw), v_z])
    tilt, _ = cv2.Rodrigues(rng.normal(0.0, params.axis_scatter, 3))
    place = np.array([params.x, params.y, params.z]) + rng.normal(0.0, params.place_scatter, 3)
    return BallState(0.0, place, velocity, tilt @ (spin * np.array(_AXES[kind]))), Rotation.random(rng=rng).as_matrix()


def shot(text: str) -> tuple[str, int]:
    """Return kind and scale of a shot from its text, e.g. ("top", 3) from "top 3".

    Raises:
        TtError: The text is not a kind and a scale.
        BadChoice: There is no such kind.
        OutOfRange: There is no such scale.
    """
    kind, _, scale = text.partition(" ")
    if not scale.isdigit():
        raise TtError(f"shot {text!r} is not a kind and a scale, as in 'top 3'")
    launch(kind, int(scale), LauncherParams(), np.random.default_rng(0))
    return kind, int(scale)
