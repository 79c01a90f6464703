"""Reasons why the arm stops, or does less than its swing (planned joint motion) asks for, each with its sentence."""

from enum import Enum


class ArmStop(Enum):
    """Reasons why the arm stops, takes no strokes or moves less than asked for, used as codes of `tt_core.failures.Failure`.

    The value of a member is the sentence for people. docs/safety.md lists the reasons that latch, which means that the arm stays stopped
    until it is enabled again.
    """

    # a person stopped it
    NOT_ENABLED = "not enabled"
    STOPPED = "stopped by /arm/stop; /arm/enable starts again"
    ENDED = "the node ends"
    # joint states that are not used
    SILENT = "no valid joint state for {age:.3f} s, at most {bound:.3f} s allowed"
    UNREADABLE = "joint state refused: {error}"
    OLD = "joint state is {age:.3f} s old, at most {bound:g} s allowed"
    AHEAD = "joint state is stamped {age:.3f} s ahead of the clock, at most {bound:g} s allowed"
    NOT_NEWER = "joint state is not newer than the one before: stamp {stamp:.6f} s after {last:.6f} s"
    NO_POSTURE = "joint {joint} at {value:g} {unit} is {beyond:g} {unit} beyond its limit, no posture of this arm"
    NO_SPEED = "joint {joint} at {value:g} {unit}/s is {share:g} times its speed limit, no speed of this arm"
    JUMP = "joint {joint} jumped by {value:g} {unit} in {passed:.4f} s, at most {bound:g} {unit} possible"
    # other nodes on the arm's topics
    SECOND_PUBLISHER = "{count} publishers on {topic} ({names}), 1 allowed"
    # these latch: damage, or a person has to look
    BEYOND_LIMIT = "joint {joint} is {value:.3f} {unit} beyond its limit, at most {bound:g} {unit} tolerated"
    OVERSPEED = "joint {joint} moves at {value:.2f} times its speed limit, at most {bound:g} tolerated"
    CONTACT = "the arm touches {obstacle}"
    INTERNAL = "internal error: {error}"
    # cuts of the guard
    BROKEN_COMMAND = "command is not {count} finite numbers: {command}"
    SPEED_CUT = "speed limit: {joints}"
    POSITION_CUT = "position limit: {joints}"
    ACCELERATION_CUT = "acceleration limit: {joints}"
    NEAR = "braking would end {left:.3f} m from {obstacle}, {bound:.3f} m wanted"
    NOT_FOLLOWING = "gave up {count} paths within {window:g} s, rests and tries again; the last time: {last}"
    OLD_PLAN = "the plan is {age:.2f} s old, at most {bound:g} s allowed"
    # others
    SLOWING = "slowing down to {scale:g} of the speed limits"
    ARRIVING = "the first motion after enabling is slow; strokes are taken once the arm is at its waiting posture"
    NO_STATE = "no joint state in time"
    FAR_AHEAD = "the strike is {ahead:.2f} s ahead, at most {bound:g} s allowed"
    STROKES_AHEAD = "strokes are stamped {age:.3f} s ahead of the clock, at most {bound:g} s allowed"
    CLOCK_OFFSET = "the clock of {source} is off by {offset:+.4f} s, at most {bound:g} s allowed"
    SWING_ON_ITS_WAY = "a swing is on its way"
    SWING_WILL_DO = "the swing on its way will do"
    SWING_COMMITTED = "the strike is {left:.3f} s ahead, the swing does not change any more within {bound:g} s"
    CORRECTION_TOO_LARGE = "a correction of {distance:.3f} m, at most {bound:g} m allowed"
    PLANNING_FAILED = "planning failed: {error}"
    STOPPED_MEANWHILE = "the arm was stopped while the swing was planned"
