"""One ball that the robot learns from: its flight as the wide cameras see it, its contact with the racket, and its return.

What is learnt are factors on the coefficients of air, table and rubber, see `tt_core.factors`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from tt_core.factors import OF_BALL
from tt_core.states import Array, BallState, RacketState
from tt_predict.learning import ExpectedReturn, PhysicsLearner
from tt_vision.camera import Camera
from tt_vision.rig import WIDE_NOISE
from tt_vision.tracking import Tracker, TrackerParams

JUST_HIT = 0.004  # s around the strike, within which it is not known whether a pixel is from before or after it
RETURN_SEEN = 0.45  # s after the strike, for which the return is tracked; it lands later


class Lesson:
    """Tracks one ball before and after its contact with the racket, and gives both flights to the learner at the end.

    Attributes:
        tracker: Tracker of the ball before the contact.
        struck: s, time of the contact with the racket; inf before it.
    """

    def __init__(self, learner: PhysicsLearner, cameras: Sequence[Camera], params: TrackerParams) -> None:
        """Start without a ball.

        Args:
            learner: Learner of the coefficients. What it has learnt so far is used for this ball.
            cameras: Cameras whose pixels will be added.
            params: Parameters of the tracker. The spreads of the factors in them are replaced by those of the learner.
        """
        self._learner, self._cameras = learner, cameras
        self._params = replace(params, **_factor_spreads(learner.spreads))
        self.tracker = Tracker(learner.physics, cameras, self._params)
        self.struck = np.inf
        self._flight: tuple[Array, Array] | None = None  # logarithms of the factors of this ball and their covariance
        self._return: tuple[ExpectedReturn, Tracker] | None = None

    def start(self, ball: BallState) -> None:
        """Give the measured ball to the tracker; ignore it after the contact with the racket."""
        if self.struck == np.inf:
            self.tracker.start(ball)

    def add_pixel(self, stamp: float, side: int, pixel: Array) -> bool:
        """Add a pixel at which a camera saw the ball.

        Args:
            stamp: s, middle of the exposure.
            side: Index of the camera.
            pixel: (2,) column and row of the ball's centre.

        Returns:
            Whether the pixel is from before the contact with the racket.
        """
        if stamp < self.struck - JUST_HIT or self.struck == np.inf:
            self.tracker.add_pixel(stamp, side, pixel, WIDE_NOISE)
            return True
        if self._return is not None and self.struck + JUST_HIT < stamp < self.struck + RETURN_SEEN:
            _, tracker = self._return
            tracker.add_pixel(stamp, side, pixel, WIDE_NOISE)
        return False

    def strike(self, racket: RacketState, turning: Array) -> None:
        """Note the contact with the racket, and start to track the return.

        Args:
            racket: The racket when it met the ball.
            turning: (3,) rad/s in `table`, its angular velocity.
        """
        self.struck = racket.time
        ball = self.tracker.state(racket.time)
        self._flight = self._known_factors()
        expected = self._learner.expect_return(ball, racket, turning) if ball is not None else None
        if expected is None:
            return
        spreads = self._learner.spreads[:OF_BALL] if self._flight is None else np.sqrt(np.diag(self._flight[1]))
        params = replace(self._params, lag=2.0 * RETURN_SEEN, **_factor_spreads(spreads))
        tracker = Tracker(self.tracker.physics, self._cameras, params)
        tracker.start(expected.ball)
        self._return = expected, tracker

    def finish(self) -> int:
        """Give flight and return to the learner.

        Returns:
            How many of the two the learner has used.
        """
        used, flight = 0, self._flight or self._known_factors()
        if flight is not None:
            used += self._learner.add_flight(*flight)
        if self._return is not None:
            expected, tracker = self._return
            seen = tracker.state(expected.ball.time)
            if seen is not None and tracker.counts.balls == 1:
                used += self._learner.add_return(expected, seen)
        return used

    def _known_factors(self) -> tuple[Array, Array] | None:
        """Return the factors of this ball; None if the tracker has lost it, and found another one."""
        return self.tracker.factors if self.tracker.counts.restarts == 0 else None


def _factor_spreads(spreads: Array) -> dict[str, float]:
    """Return the parameters of a tracker for standard deviations (5 or more,) of the factors."""
    names = ("drag_spread", "lift_spread", "restitution_spread", "friction_spread", "grip_spread")
    return {name: max(1e-3, float(value)) for name, value in zip(names, spreads, strict=False)}
