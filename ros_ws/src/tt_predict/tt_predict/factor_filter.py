"""Filter for factors that differ from session to session and from ball to ball, where it is not known how much from ball to ball.

The logarithms of the factors of one ball are the sum of those of its session and of a difference of this ball; both have normal
distributions. A Kalman filter estimates those of the session. How large the differences are is one of a few hypotheses. Each has a Kalman
filter of its own, and a probability that follows, by Bayes' rule, from how well its filter has predicted the balls (multiple model
estimation, Y. Bar-Shalom, X. R. Li and T. Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, Section 11.6).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from tt_core.arrays import Array

FIRST_PROBABILITY = 0.9  # of the first hypothesis at the start; the other hypotheses have equal parts of the rest
LEAST_PROBABILITY = 1e-3  # of each hypothesis; from 0 it could never rise again when the balls change
LEAST_VARIANCE = 1e-10  # smallest variance of the logarithm of a factor
INFORMATIVE = 1e-4  # the gate ignores a factor if a ball reduces its variance by less than this share of its variance between sessions


class FactorFilter:
    """Estimates the logarithms of n factors by several Kalman filters, each of which assumes another spread from ball to ball.

    Attributes:
        mean: (n,) logarithms of the session's factors, the mean over the hypotheses; 0 is a factor of 1.
        covariance: (n, n) covariance of the logarithms of the next ball's factors about `mean`.
        probabilities: (k,) of the hypotheses, with sum 1.
    """

    def __init__(self, session: Array, ball: Array, scales: Sequence[float], drift: float, farthest: float) -> None:
        """Create a filter that has seen no ball: the mean of each factor is 1, and the first hypothesis has FIRST_PROBABILITY.

        Args:
            session: (n,) standard deviations of the logarithms from session to session.
            ball: (n,) standard deviations from ball to ball in a session, which the hypotheses multiply.
            scales: (k,) factors on `ball`, one for each hypothesis; at least two.
            drift: Standard deviation of the change of a session from one ball to the next, as a share of `session`.
            farthest: Largest logarithm that is learnt, as a multiple of `session`.
        """
        self._session, self._drift, self._most = session, np.diag((drift * session) ** 2), farthest * session
        self._balls = np.array([np.diag((scale * ball) ** 2) for scale in scales])
        self._means = np.zeros((len(scales), len(session)))
        self._covariances = np.repeat(np.diag(session**2)[None], len(scales), axis=0)
        self.probabilities = np.full(len(scales), (1.0 - FIRST_PROBABILITY) / (len(scales) - 1))
        self.probabilities[0] = FIRST_PROBABILITY
        self._combine()

    def _combine(self) -> None:
        """Set `mean` and `covariance` to those over all hypotheses, weighted by their probabilities."""
        self.mean = self.probabilities @ self._means
        apart = self._means - self.mean
        spreads = self._covariances + self._balls + apart[:, :, None] * apart[:, None, :]
        self.covariance = np.tensordot(self.probabilities, spreads, axes=1)

    def add(self, prior: Array, found: Array, posterior: Array, gate: float) -> bool:
        """Learn from the estimated factors of one ball.

        Args:
            prior: (n, n) covariance, about `mean`, with which the factors of this ball were estimated.
            found: (n,) their estimated logarithms, relative to `mean`.
            posterior: (n, n) covariance of `found`.
            gate: Squared distance of an estimate from its expectation, in standard deviations, above which it is not used.

        Returns:
            Whether it was used.
        """
        expected = np.diag(prior - posterior)  # variances that the estimates should have
        informative = expected > INFORMATIVE * self._session**2
        if (found[informative] ** 2 > gate * expected[informative]).any():
            return False
        information, vector = _information(prior, found, posterior)
        evidence = [self._add(k, information, vector) for k in range(len(self.probabilities))]
        likelihoods = self.probabilities * np.exp(np.array(evidence) - max(evidence))
        probabilities = np.maximum(likelihoods / likelihoods.sum(), LEAST_PROBABILITY)
        self.probabilities = probabilities / probabilities.sum()
        self._combine()
        return True

    def _add(self, k: int, information: Array, vector: Array) -> float:
        """Update the Kalman filter of one hypothesis with the measurements of one ball.

        Args:
            k: Index of the hypothesis.
            information: (n, n) inverse covariance of the ball's factors from the measurements alone, without a prior. It may be singular.
            vector: (n,) `information` times the ball's factors from the measurements alone, relative to `mean`.

        Returns:
            Logarithm of the probability density of the measurements under this hypothesis, up to a constant.
        """
        before = self._covariances[k] + self._balls[k]
        inverse, apart = np.linalg.inv(before), self._means[k] - self.mean
        after = np.linalg.inv(inverse + information)
        combined = inverse @ apart + vector
        estimate = after @ combined
        gain = self._covariances[k] @ inverse
        covariance = self._covariances[k] - gain @ (before - after) @ gain.T + self._drift
        self._covariances[k] = _at_least(covariance, LEAST_VARIANCE)
        self._means[k] = np.clip(self._means[k] + gain @ (estimate - apart), -self._most, self._most)
        volumes = np.linalg.slogdet(after)[1] - np.linalg.slogdet(before)[1]
        return float(0.5 * (volumes + estimate @ combined - apart @ inverse @ apart))


def _information(prior: Array, found: Array, posterior: Array) -> tuple[Array, Array]:
    """Remove the prior, which has mean 0, from an estimate. Return the inverse covariance (n, n), and its product with the mean (n,)."""
    inverse = np.linalg.inv(_at_least(posterior, LEAST_VARIANCE))
    return _at_least(inverse - np.linalg.inv(prior), 0.0), inverse @ found


def _at_least(matrix: Array, least: float) -> Array:
    """Make a matrix (n, n) symmetric, and raise its eigenvalues to `least` where rounding has made them smaller."""
    values, axes = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return np.asarray(axes * np.maximum(values, least) @ axes.T)
