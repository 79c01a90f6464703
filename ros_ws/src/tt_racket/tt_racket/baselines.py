"""Strokes of earlier robots, for comparison: they know no spin and no air.

Both aim along the parabola that leads to the goal in the asked time. `residual` is how far the full models then miss the goal.
"""

from __future__ import annotations

import math

import numpy as np
from tt_core.arrays import Array
from tt_core.flight import fly
from tt_core.physics import Physics
from tt_core.states import BallState, RacketState, ReturnGoal

from .stroke import Stroke

LOSS = 0.30  # of the energy relative to the racket, Acosta; dissertation Section 1.2
PITCH = 0.35  # rad, elevation of the racket's normal, an assumption


def _parabola(ball: BallState, goal: ReturnGoal, physics: Physics) -> Array:
    """Return the velocity (3,) m/s after the hit that leads to the goal in the asked time without air."""
    way = np.append(goal.landing, physics.contact_height) - ball.position
    return way / goal.flight_time + [0.0, 0.0, 0.5 * physics.air.gravity * goal.flight_time]


def _stroke(ball: BallState, goal: ReturnGoal, physics: Physics, normal: Array, velocity: Array) -> Stroke:
    """Return the stroke with that face normal (3,) and racket velocity (3,), and what the full models make of it."""
    racket = RacketState.facing(ball.time, ball.position - physics.contact_height * normal, velocity, normal)
    after = physics.racket.after(ball.velocity, ball.spin, racket)
    end = fly(np.concatenate([ball.position, *after]), goal.flight_time, physics.air.coefficients)
    residual = math.dist(end[:3], (*goal.landing, physics.contact_height))
    return Stroke(racket, BallState(ball.time, ball.position, *after), residual, 0)


def specular(ball: BallState, goal: ReturnGoal, physics: Physics, loss: float = LOSS) -> Stroke:
    """Return Acosta's stroke: a mirror that loses energy and moves along its normal.

    The angle out is the angle in, and `loss` of the energy relative to the racket is lost: v1 - V = k (v0 - V - 2 n n.(v0 - V)) with
    k^2 = 1 - loss. With V = s n, the normal n lies along v1 - k v0.

    Args:
        ball: At the hit.
        goal: Its landing and flight time are aimed at.
        physics: Gravity and contact height; the full models for the residual.
        loss: Share of the energy.
    """
    kept, wanted = math.sqrt(1.0 - loss), _parabola(ball, goal, physics)
    normal = wanted - kept * ball.velocity
    normal = normal / np.linalg.norm(normal)
    speed = (wanted @ normal + kept * (ball.velocity @ normal)) / (1.0 + kept)
    return _stroke(ball, goal, physics, normal, speed * normal)


def fixed_pitch(ball: BallState, goal: ReturnGoal, physics: Physics, pitch: float = PITCH, loss: float = LOSS) -> Stroke:
    """Return Yang's stroke: a racket of fixed pitch that moves along its normal.

    The normal's heading halves the angle between the ball's ways in and out, as a mirror does. The racket is as fast as the way to the goal
    in the asked time needs.

    Args:
        ball: At the hit.
        goal: Its landing and flight time are aimed at.
        physics: Gravity and contact height; the full models for the residual.
        pitch: rad, elevation of the normal.
        loss: Share of the energy relative to the racket.
    """
    kept, wanted = math.sqrt(1.0 - loss), _parabola(ball, goal, physics)
    ways = np.array([v[:2] / max(1e-9, float(np.hypot(*v[:2]))) for v in (-ball.velocity, wanted)])
    heading = ways.sum(axis=0) / max(1e-9, float(np.hypot(*ways.sum(axis=0))))
    normal = np.array([math.cos(pitch) * heading[0], math.cos(pitch) * heading[1], math.sin(pitch)])
    out = np.append(ways[1], 0.0)  # in v1 = k (v0 - 2 n n.v0) + (1 + k) s n the part along this is as wanted
    mirrored = kept * (ball.velocity - 2.0 * normal * (ball.velocity @ normal))
    speed = (wanted - mirrored) @ out / ((1.0 + kept) * (normal @ out))
    return _stroke(ball, goal, physics, normal, speed * normal)
