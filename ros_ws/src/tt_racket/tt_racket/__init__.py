"""Computation of strokes: racket position, orientation and velocity at one time that return the ball to a goal (dissertation Chapter 4).

The dissertation is the Nagoya dissertation "Racket Control and Spinning Ball Measurement for Table Tennis Robot". The steps are: predicted
path of the ball -> points where it may be hit -> strokes -> relaxed goals where no stroke meets the goal as asked -> order of preference.
"""

from .failures import StrokeFailure
from .stroke import Stroke, solve

__all__ = ["Stroke", "StrokeFailure", "solve"]
