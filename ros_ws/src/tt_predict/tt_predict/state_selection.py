"""Selection of the ball states from which a path is predicted: not every state, and none before the spin is roughly known."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from tt_core.arrays import SPIN
from tt_core.ball_change import BallChange
from tt_core.params import check, param
from tt_core.states import BallState


@dataclass(frozen=True)
class StateSelectionParams:
    """Parameters that select the ball states from which a path is predicted.

    A path is predicted at most every `interval` (s). It is predicted only if the standard deviation of the spin about each axis is below
    `known_spin` (rad/s), or if `patience` (s) has passed since the first state of the ball.
    """

    interval: float = param(
        0.0, "s", "least time between two states that are predicted; a tracker sends more than the nodes behind can use", low=0.0, high=1.0
    )
    known_spin: float = param(
        100.0,
        "rad/s",
        "standard deviation of the spin about any axis below which a state is predicted at once; 394 before anything is seen, which is "
        "30 cm at the strike",
        low=0.0,
        high=1e4,
    )
    patience: float = param(
        0.12, "s", "time since the first state of a ball after which one is predicted although its spin is not known", low=0.0, high=10.0
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


class StateSelection:
    """Selection of the states from which a path is predicted, for all balls in turn; it detects itself when a new ball comes."""

    def __init__(self, params: StateSelectionParams) -> None:
        """Create it without a ball."""
        self._params = params
        self._first = self._predicted = -math.inf  # s: of the ball's first state, and of the last predicted one
        self._change = BallChange()

    def takes(self, ball: BallState) -> bool:
        """Return whether a path is to be predicted from this state, and remember the state.

        Call it with every state of a ball, in the order of time.
        """
        params = self._params
        if self._change.is_new(ball.time, float(ball.position[0])):
            self._first, self._predicted = ball.time, -math.inf
        is_new = ball.time - self._predicted >= params.interval
        if not is_new or not (self._knows_spin(ball) or ball.time >= self._first + params.patience):
            return False
        self._predicted = ball.time
        return True

    def _knows_spin(self, ball: BallState) -> bool:
        return ball.covariance is None or float(np.diag(ball.covariance)[SPIN].max()) < self._params.known_spin**2
