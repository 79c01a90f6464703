"""Strokes of earlier robots, for comparison: they neglect the spin of the ball and the forces of the air.

Both aim along the parabola that leads to the goal in the asked flight time. The `residual` of these strokes is the distance in m by which
the ball misses the goal in the full models of air and rubber.
"""

from __future__ import annotations

import math

import numpy as np
from tt_core.arrays import Array
from tt_core.flight import fly
from tt_core.physics import Physics
from tt_core.states import BallState, RacketState, ReturnGoal

from .stroke import Stroke

LOSS = 0.30  # lost share of the ball's energy relative to the racket, Acosta; dissertation Section 1.2
PITCH = 0.35  # rad, elevation of the racket's normal, an assumption


def _parabola(ball: BallState, goal: ReturnGoal, physics: Physics) -> Array:
    """Return the velocity (3,) m/s after the hit with which the ball reaches the goal in the asked time without forces of the air."""
    way = np.append(goal.landing, physics.contact_height) - ball.position
    return way / goal.flight_time + [0.0, 0.0, 0.5 * physics.air.gravity * goal.flight_time]


def _stroke(ball: BallState, goal: ReturnGoal, physics: Physics, normal: Array, velocity: Array) -> Stroke:
    """Return the stroke with this face normal (3,) and racket velocity (3,) m/s; ball after the hit and residual are of the full models."""
    racket = RacketState.facing(ball.time, ball.position - physics.contact_height * normal, velocity, normal)
    after = physics.racket.after(ball.velocity, ball.spin, racket)
    end = fly(np.concatenate([ball.position, *after]), goal.flight_time, physics.air.coefficients)
    residual = math.dist(end[:3], (*goal.landing, physics.contact_height))
    return Stroke(racket, BallState(ball.time, ball.position, *after), residual, 0)


def specular(ball: BallState, goal: ReturnGoal, physics: Physics, loss: float = LOSS) -> Stroke:
    """Return the stroke of Acosta's robot: the racket reflects the ball like a mirror with loss of energy, and moves along its normal.

    The angle of reflection equals the angle of incidence. With ball velocities v0 and v1 before and after the hit, racket velocity V and
    normal n the model is v1 - V = k (v0 - V - 2 n n.(v0 - V)) with k^2 = 1 - loss. With V = s n, the normal n is parallel to v1 - k v0.

    Args:
        ball: Ball just before the hit.
        goal: Landing place and flight time to aim at; its spin is ignored.
        physics: Gravity and contact height are used for the stroke, the full models for its residual.
        loss: Share of the ball's energy relative to the racket that is lost, 0 to 1.
    """
    kept, wanted = math.sqrt(1.0 - loss), _parabola(ball, goal, physics)
    normal = wanted - kept * ball.velocity
    normal = normal / np.linalg.norm(normal)
    speed = (wanted @ normal + kept * (ball.velocity @ normal)) / (1.0 + kept)
    return _stroke(ball, goal, physics, normal, speed * normal)


def fixed_pitch(ball: BallState, goal: ReturnGoal, physics: Physics, pitch: float = PITCH, loss: float = LOSS) -> Stroke:
    """Return the stroke of Yang's robot: the racket has a fixed pitch angle and moves along its normal.

    In the horizontal plane, the normal halves the angle between the reversed incoming direction and the outgoing direction of the ball, as
    in a mirror. The racket's speed is chosen so that the horizontal speed of the ball leads to the goal in the asked time.

    Args:
        ball: Ball just before the hit.
        goal: Landing place and flight time to aim at; its spin is ignored.
        physics: Gravity and contact height are used for the stroke, the full models for its residual.
        pitch: rad, elevation of the normal above the horizontal plane.
        loss: Share of the ball's energy relative to the racket that is lost, 0 to 1.
    """
    kept, wanted = math.sqrt(1.0 - loss), _parabola(ball, goal, physics)
    ways = np.array([v[:2] / max(1e-9, float(np.hypot(*v[:2]))) for v in (-ball.velocity, wanted)])
    heading = ways.sum(axis=0) / max(1e-9, float(np.hypot(*ways.sum(axis=0))))
    normal = np.array([math.cos(pitch) * heading[0], math.cos(pitch) * heading[1], math.sin(pitch)])
    out = np.append(ways[1], 0.0)  # in v1 = k (v0 - 2 n n.v0) + (1 + k) s n the part along this is as wanted
    mirrored = kept * (ball.velocity - 2.0 * normal * (ball.velocity @ normal))
    speed = (wanted - mirrored) @ out / ((1.0 + kept) * (normal @ out))
    return _stroke(ball, goal, physics, normal, speed * normal)
