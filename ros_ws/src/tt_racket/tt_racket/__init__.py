"""The racket state that returns the ball to a goal (dissertation Chapter 4): path -> hit points -> strokes -> relaxed goals -> order."""

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
