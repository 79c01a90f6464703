"""Strokes of earlier robots, which know no spin and no air: what the others are measured against.

Both aim along the parabola that leads to the goal in the asked time. `residual` is what the full models make of it.
"""

from __future__ import annotations

import math

import numpy as np
from tt_core.flight import fly
from tt_core.physics import Physics
from tt_core.states import Array, BallState, RacketState, ReturnGoal

from .stroke import Stroke

LOSS = 0.30  # of the energy relative to the racket, Acosta; dissertation Section 1.2
PITCH = 0.35  # rad, elevation of the racket's normal, an assumption


def _parabola(ball: BallState, goal: ReturnGoal, physics: Physics) -> Array:
    """(3,) m/s after the hit."""
    way = np.append(goal.landing, physics.contact_height) - ball.position
    return way / goal.flight_time + [0.0, 0.0, 0.5 * physics.air.gravity * goal.flight_time]


def _stroke(ball: BallState, goal: ReturnGoal, physics: Physics, normal: Array, velocity: Array) -> Stroke:
    racket = RacketState.facing(ball.time, ball.position - physics.contact_height * normal, velocity, normal)
    after = physics.racket.after(ball.velocity, ball.spin, racket)
    end = fly(np.concatenate([ball.position, *after]), goal.flight_time, physics.air.coefficients)
    residual = math.dist(end[:3], (*goal.landing, physics.contact_height))
    return Stroke(racket, BallState(ball.time, ball.position, *after), residual, 0)


def specular(ball: BallState, goal: ReturnGoal, physics: Physics, loss: float = LOSS) -> Stroke:
    """Acosta's: angle out is angle in and `loss` of the energy relative to the racket is lost; the racket moves along its normal.

    v1 - V = k (v0 - V - 2 n n.(v0 - V)) with k^2 = 1 - loss and V = s n has n along v1 - k v0.
    """
    kept, wanted = math.sqrt(1.0 - loss), _parabola(ball, goal, physics)
    normal = wanted - kept * ball.velocity
    normal = normal / np.linalg.norm(normal)
    speed = (wanted @ normal + kept * (ball.velocity @ normal)) / (1.0 + kept)
    return _stroke(ball, goal, physics, normal, speed * normal)


def fixed_pitch(ball: BallState, goal: ReturnGoal, physics: Physics, pitch: float = PITCH, loss: float = LOSS) -> Stroke:
    """Yang's: the normal's elevation `pitch` (rad) is fixed, its heading halves the angle between the ball's ways in and out, as a mirror
    does; the racket moves along its normal, as fast as the way to the goal in the asked time needs with that loss of energy."""
    kept, wanted = math.sqrt(1.0 - loss), _parabola(ball, goal, physics)
    ways = np.array([v[:2] / max(1e-9, float(np.hypot(*v[:2]))) for v in (-ball.velocity, wanted)])
    heading = ways.sum(axis=0) / max(1e-9, float(np.hypot(*ways.sum(axis=0))))
    normal = np.array([math.cos(pitch) * heading[0], math.cos(pitch) * heading[1], math.sin(pitch)])
    out = np.append(ways[1], 0.0)  # v1 = k (v0 - 2 n n.v0) + (1 + k) s n, its part along the way out as wanted
    mirrored = kept * (ball.velocity - 2.0 * normal * (ball.velocity @ normal))
    speed = (wanted - mirrored) @ out / ((1.0 + kept) * (normal @ out))
    return _stroke(ball, goal, physics, normal, speed * normal)
