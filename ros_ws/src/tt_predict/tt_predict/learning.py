"""Learn the coefficients of the models from ball to ball, from incoming flights and from returns.

The learnt quantities are the logarithms of the seven factors of `tt_core.factors`, by which the coefficients are multiplied. An incoming
flight gives information on the first five, which the tracker estimates with every ball. A return gives information on the two factors of
the rubber: the ball after the contact is predicted from the ball before it and the racket, and compared with the ball that the cameras see.
One `FactorFilter` learns the five, another one the two. Each also estimates how much single balls differ from the others of their session:
the more they differ, the less is learnt from one ball. An observation that is too far from its expectation is not used.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from tt_core.arrays import POSITION, SPIN, VELOCITY, Array
from tt_core.errors import check_array
from tt_core.factors import FACTORS, OF_BALL, scaled
from tt_core.params import check, param
from tt_core.physics import Physics
from tt_core.states import BallState, RacketState

from .factor_filter import FactorFilter

OF_RUBBER = slice(OF_BALL, len(FACTORS))
DIFFERENCE_STEPS = np.concatenate(
    [np.repeat([1e-5, 1e-4, 1e-2], 3), np.full(5, 1e-4)]
)  # steps of finite differences, ball and racket, SI units
# elements of a change (16,) of a contact: ball, racket velocity m/s, alpha and beta rad, logarithms of the factors of the rubber
CHANGED_BALL, CHANGED_VELOCITY, CHANGED_ALPHA, CHANGED_BETA, CHANGED_RUBBER = slice(0, 9), slice(9, 12), 12, 13, slice(14, 16)
CHANGED_ANGLES = slice(12, 14)
FACTOR_STEP = 1e-4  # step of finite differences, logarithm of a factor
SLOWEST = 0.5  # m/s, least approach speed of ball and racket; a slower contact is not used


@dataclass(frozen=True)
class LearningParams:
    """Parameters of the learning: how much the coefficients differ between sessions and balls, and how fast and how far they are learnt."""

    session_spreads: tuple[float, ...] = param(
        (0.04, 0.10, 0.01, 0.05, 0.08, 0.03, 0.04),
        "",
        "standard deviations, from session to session, of the factors on drag, lift, restitution, friction and grip of the table, "
        "restitution and grip of the rubber",
        low=1e-5,
        high=1.0,
    )
    ball_spreads: tuple[float, ...] = param(
        (0.008, 0.02, 0.002, 0.01, 0.016, 0.006, 0.008),
        "",
        "the same from ball to ball in a session, in the order of session_spreads",
        low=1e-5,
        high=1.0,
    )
    ball_scales: tuple[float, ...] = param(
        (1.0, 2.0, 5.0),
        "",
        "candidates for a factor on ball_spreads, weighted by how well they predict the balls; at the start the first has the most weight",
        low=0.01,
        high=100.0,
    )
    drift: float = param(
        0.02, "", "standard deviation of the change from one ball to the next, as a share of session_spreads", low=0.0, high=1.0
    )
    farthest: float = param(3.0, "", "largest change that is learnt, as a multiple of session_spreads", low=0.0, high=10.0)
    gate: float = param(
        20.0,
        "",
        "squared distance of an observation from its expectation, in standard deviations, above which it is left out",
        low=1.0,
        high=1e6,
    )
    racket_velocity: float = param(0.01, "m/s", "standard deviation of the known velocity of the racket, on each axis", low=1e-4, high=1.0)
    racket_angle: float = param(
        0.002, "rad", "standard deviation of the known face of the racket, about each of its axes", low=1e-5, high=0.1
    )

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedReturn:
    """The state that the ball is expected to have after its contact with the racket.

    Attributes:
        ball: State after the contact, extrapolated along a straight line to the time of the racket state. Its covariance comes from the
            uncertainties of the ball before the contact, of the racket and of the rubber's factors.
        slopes: (9, 2) derivatives of the state (m, m/s, rad/s) by the logarithms of the rubber's two factors.
    """

    ball: BallState
    slopes: Array


class PhysicsLearner:
    """Learns the factors on the coefficients of the models from ball to ball."""

    def __init__(self, physics: Physics, params: LearningParams | None = None) -> None:
        """Start from given models, with the uncertainty that the factors have from session to session.

        Args:
            physics: Models whose coefficients are multiplied by the learnt factors.
            params: How fast and how far to learn; None for the default.
        """
        self.params, self._models = params or LearningParams(), physics
        session, ball = np.array(self.params.session_spreads), np.array(self.params.ball_spreads)
        self._air_and_table, self._rubber = (
            FactorFilter(session[part], ball[part], self.params.ball_scales, self.params.drift, self.params.farthest)
            for part in (slice(OF_BALL), OF_RUBBER)
        )

    @property
    def logarithms(self) -> Array:
        """Logarithms (7,) of the factors learnt so far, in the order of FACTORS; 0 is a factor of 1."""
        return np.concatenate([self._air_and_table.mean, self._rubber.mean])

    @property
    def physics(self) -> Physics:
        """The models with their coefficients multiplied by the learnt factors."""
        return scaled(self._models, self.logarithms)

    @property
    def spreads(self) -> Array:
        """Standard deviations (7,) of the logarithms of the next ball's factors about the learnt ones, in the order of FACTORS."""
        return np.sqrt(np.concatenate([np.diag(self._air_and_table.covariance), np.diag(self._rubber.covariance)]))

    def add_flight(self, logarithms: Array, covariance: Array) -> bool:
        """Learn from an incoming flight, whose tracker had `physics` as models and `spreads` as prior standard deviations.

        Args:
            logarithms: (5,) logarithms of the factors that the tracker estimated for this ball, relative to the learnt ones; the result of
                `Tracker.factors`.
            covariance: (5, 5) covariance of `logarithms`.

        Returns:
            Whether it was used; False if it is too far from the expectation.

        Raises:
            BadShape: An array has another shape.
            NotFinite: A number is NaN or infinite.
        """
        found = check_array("logarithms", logarithms, (OF_BALL,))
        posterior = check_array("covariance", covariance, (OF_BALL, OF_BALL))
        return self._air_and_table.add(np.diag(self.spreads[:OF_BALL] ** 2), found, posterior, self.params.gate)

    def expect_return(self, ball: BallState, racket: RacketState, turning: Array) -> ExpectedReturn | None:
        """Predict the state of the ball after its contact with the racket.

        Args:
            ball: State before the contact with covariance, at the same time as `racket`, which must be close to the contact.
            racket: Measured state of the racket.
            turning: (3,) rad/s in `table`, angular velocity of the racket.

        Returns:
            The expected state. None if `ball` has no covariance, or if ball and racket approach each other with less than SLOWEST.
        """
        if ball.covariance is None:
            return None
        physics = self.physics

        def after(change: Array, rubber: Array) -> Array | None:
            """Return the ball (9,) after the contact for changes of ball and racket (14,) and of the rubber's logarithms (2,), or None."""
            changed = RacketState(
                racket.time,
                racket.position,
                racket.velocity + change[CHANGED_VELOCITY],
                racket.alpha + change[CHANGED_ALPHA],
                racket.beta + change[CHANGED_BETA],
            )
            rubbered = scaled(physics, [*np.zeros(OF_BALL), *rubber]) if rubber.any() else physics
            return _rebounded(ball.vector + change[CHANGED_BALL], changed, turning, rubbered)

        middle = after(np.zeros(14), np.zeros(2))
        if middle is None:
            return None
        columns = []
        for i in range(16):
            ends = []
            for sign in (-1.0, 1.0):
                change = np.zeros(16)
                change[i] = sign * (DIFFERENCE_STEPS[i] if i < 14 else FACTOR_STEP)
                ends.append(after(change[:14], change[CHANGED_RUBBER]))
            if ends[0] is None or ends[1] is None:
                return None
            columns.append((ends[1] - ends[0]) / (2.0 * (DIFFERENCE_STEPS[i] if i < 14 else FACTOR_STEP)))
        jacobian = np.array(columns).T
        inputs = np.zeros((16, 16))
        inputs[CHANGED_BALL, CHANGED_BALL] = ball.covariance
        inputs[CHANGED_VELOCITY, CHANGED_VELOCITY] = np.eye(3) * self.params.racket_velocity**2
        inputs[CHANGED_ANGLES, CHANGED_ANGLES] = np.eye(2) * self.params.racket_angle**2
        inputs[CHANGED_RUBBER, CHANGED_RUBBER] = self._rubber.covariance
        return ExpectedReturn(BallState.from_vector(ball.time, middle, jacobian @ inputs @ jacobian.T), jacobian[:, CHANGED_RUBBER])

    def add_return(self, expected: ExpectedReturn, seen: BallState) -> bool:
        """Learn the factors of the rubber from a return, by Rauch-Tung-Striebel smoothing.

        Args:
            expected: Result of `expect_return` for this contact.
            seen: State of the ball at the same time as `expected.ball`, estimated by a tracker that was started with `expected.ball` and
                has followed the return.

        Returns:
            Whether it was used; False if it is too far from the expectation, or if a covariance is missing.
        """
        if seen.covariance is None or expected.ball.covariance is None:
            return False
        before = expected.ball.covariance
        scale = np.sqrt(np.diag(before))
        inverse = np.linalg.pinv(before / np.outer(scale, scale), rcond=1e-10, hermitian=True) / np.outer(scale, scale)
        prior = self._rubber.covariance
        gain = prior @ expected.slopes.T @ inverse
        posterior = prior - gain @ (before - seen.covariance) @ gain.T
        return self._rubber.add(prior, gain @ (seen.vector - expected.ball.vector), posterior, self.params.gate)


def _rebounded(ball: Array, racket: RacketState, turning: Array, physics: Physics) -> Array | None:
    """Return the ball (9,) after the contact with the racket, or None if they approach each other with less than SLOWEST.

    The ball moves straight from its position to the contact. The state after the contact is extrapolated straight back to the same time.
    """
    normal = racket.normal
    offset, towards = ball[POSITION] - racket.position, ball[VELOCITY] - racket.velocity
    if towards @ normal > 0.0:
        normal = -normal
    closing = float(towards @ normal)
    if closing > -SLOWEST:
        return None
    time = (physics.contact_height - float(offset @ normal)) / closing  # s until the contact
    point = offset + time * towards - physics.contact_height * normal
    moving = replace(racket, velocity=racket.velocity + np.cross(turning, point))
    velocity, spin = physics.racket.after(ball[VELOCITY], ball[SPIN], moving)
    return np.concatenate([ball[POSITION] + time * (ball[VELOCITY] - velocity), velocity, spin])
