"""Prediction of the path of the ball through flight and bounces, and fits of the models' coefficients (dissertation Chapters 3 and 4).

The dissertation is the Nagoya dissertation "Racket Control and Spinning Ball Measurement for Table Tennis Robot", here also called Liu's.
Functions that have the name of their module are imported from there: `tt_predict.rollout.rollout`, `tt_predict.uncertainty.uncertainty`,
`tt_predict.identify.identify`.
"""

from .rollout import StopRule

__all__ = ["StopRule"]
