"""Computation of strokes: racket position, orientation and velocity at one time that return the ball to a goal (dissertation Chapter 4).

The dissertation is the Nagoya dissertation "Racket Control and Spinning Ball Measurement for Table Tennis Robot". The steps are: predicted
path of the ball -> points where it may be hit -> strokes -> relaxed goals where no stroke meets the goal as asked -> order of preference.
"""

from .failures import StrokeFailure
from .goal import GoalParams, default_goal
from .goal_relaxation import AS_ASKED, GoalPart, Relaxation, RelaxationParams, Return, relax_goal
from .intercept import Candidates, InterceptParams, hit_points
from .sensitivity import StrikeErrorParams, landing_rms
from .stroke import Stroke, solve

__all__ = [
    "AS_ASKED",
    "Candidates",
    "GoalParams",
    "GoalPart",
    "InterceptParams",
    "Relaxation",
    "RelaxationParams",
    "Return",
    "StrikeErrorParams",
    "Stroke",
    "StrokeFailure",
    "default_goal",
    "hit_points",
    "landing_rms",
    "relax_goal",
    "solve",
]
