"""The path of the ball through flight and bounces (dissertation Chapters 3 and 4).

Functions that have the name of their module are imported from there: `tt_predict.rollout.rollout`, `tt_predict.uncertainty.uncertainty`,
`tt_predict.identify.identify`.
"""

from .rollout import StopRule, thinned

__all__ = ["StopRule", "thinned"]
