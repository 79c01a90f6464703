"""Limits that a swing (the joint motion that makes a stroke) must keep, and the reasons why there is no swing."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from tt_core.constants import COMMAND_TIMEOUT
from tt_core.params import check, param

from ..joints import HOLD_RESERVE, JERK, JOINT_ACCELERATION, JointLimits
from ..model import ArmModel
from .legs import PROFILE_NAMES


class SwingFailure(Enum):
    """Codes of failures: why there is no swing that makes the strike (the hit of the ball)."""

    NO_WAY = "the limits allow no way to this strike"
    TOO_SOON = "the strike is {missing:.3f} s too soon"
    TOO_LATE = "the limits allow no way that arrives as late as the strike"
    TOO_FAST = "the arm moves too fast to arrive as late as the strike"
    NO_WAY_BACK = "the limits allow no way back to waiting"
    POSITION_LIMIT = "joint {joint} would come within {distance:.3f} {unit} of its limit on the way"
    HELD_COMMAND = "joint {joint} would run {beyond:.3f} {unit} beyond its limit if its drive held a command"
    SPEED_LIMIT = "joint {joint} would need {share:.3f} of its speed limit on the way"
    ACCELERATION_LIMIT = "joint {joint} would need {share:.3f} of its acceleration limit on the way"
    JERK_LIMIT = "joint {joint} would need {share:.3f} of its jerk limit on the way"
    CLEARANCE = "the arm would come within {distance:.3f} m of {obstacle} on the way or braking there"
    TORQUE_LIMIT = "joint {joint} would need {share:.2f} of its rated torque on the way"


@dataclass(frozen=True, slots=True)
class SwingLimits:
    """Parameters that limit swings: shares of the arm's limits, distances to keep, and the profile of the joints' motion."""

    acceleration: float = param(
        JOINT_ACCELERATION,
        "rad/s^2",
        "acceleration limit of each joint whose description states none; the PA10 needs 0.76 of its rated torque at most with this one "
        "(assumed inertias)",
        low=0.1,
        high=1000.0,
    )
    speed_share: float = param(1.0, "", "share of the speed limits that a swing may use", low=0.01, high=1.0)
    unhurried: float = param(
        1.4, "", "duration of a leg from rest to the strike, in its least times, where there is time enough", low=1.0, high=10.0
    )
    unhurried_return: float = param(
        1.0, "", "duration of the way back, in its least times; 1, because the next ball comes soon", low=1.0, high=10.0
    )
    torque_share: float = param(
        1.0, "", "share of the rated torque that a swing may need, checked over the whole path with assumed inertias", low=0.01, high=100.0
    )
    margin: float = param(
        0.02,
        "rad",
        "distance of a swing from the position limits; at least `guard.margin`, which is checked at the start",
        low=0.0,
        high=0.5,
    )
    clearance: float = param(
        0.010,
        "m",
        "distance of racket and forearm from table, floor and arm; at least `guard.clearance`, which is checked at the start",
        low=0.0,
        high=0.5,
    )
    command_timeout: float = param(
        COMMAND_TIMEOUT,
        "s",
        "time for which the drives hold a command; from anywhere on a path they may do that, then brake, without touching anything",
        low=0.0,
        high=10.0,
    )
    hold_reserve: float = param(
        HOLD_RESERVE,
        "s",
        "time beyond `command_timeout` for which a command may act, because of its transport or of repeated delays of this process",
        low=0.0,
        high=10.0,
    )
    jerk: float = param(
        JERK,
        "rad/s^3",
        'jerk limit of each joint whose description states none, not used by the profile "polyline"; our choice: 5 ms from rest to '
        "20 rad/s^2",
        low=1.0,
        high=1000000.0,
    )
    profile: str = param("auto", "", "profile of a joint's motion, see `tt_arm.swing`", choices=PROFILE_NAMES)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)

    @property
    def ramp(self) -> float:
        """Time (s) by which the jerk limit makes a leg longer, see `profiles`. In a leg all joints begin and end their motion together."""
        return 0.0 if self.profile == "polyline" else 2.0 * self.acceleration / self.jerk

    @property
    def hold(self) -> float:
        """Longest time (s) for which a velocity command may act, including delays."""
        return self.command_timeout + self.hold_reserve

    def of_joints(self, model: ArmModel) -> JointLimits:
        """Return the joint limits that a swing (planned joint motion) must keep: those of the arm, reduced by these parameters."""
        return model.limits.reduced(
            speed=self.speed_share, effort=self.torque_share, margin=self.margin, acceleration=self.acceleration, jerk=self.jerk
        )
