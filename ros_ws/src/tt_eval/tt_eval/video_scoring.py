"""Result of a ball from the pixels of two wide cameras alone, as the dissertation evaluates its experiments (Section 4.5.2).

The dissertation draws a smooth curve through the observed positions and reads landing place and time from it; it gives no spin of a return.
Here, too, only positions are used. A kink of the trajectory is a contact with the surface that is there. The flights between kinks are
fitted by the flight model, with the air as identified in that laboratory (Section 3.5.1), and two flights meet at the contact. The spin
follows from the curvature of the flight, so only its part across the velocity is observable; spin_x, nearly along the velocity, is hardly
known.

Errors over 500 balls, judged minus true, standard deviations: in the world `liu` landing place 0.4 mm, flight time 0.1 ms, spin 1 and 2
rad/s about y and z; in `real` 2.3 mm, 0.3 ms, 25 and 22 rad/s. Real lift hardly grows with the spin and differs from ball to ball, so a
flight shows little of its spin. `ros2 run tt_eval evaluate` prints these errors for any sweep.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit
from tt_core.arrays import POSITION, SPIN, VELOCITY, VZ, Array, X, Y, Z
from tt_core.constants import BALL_RADIUS, NET_HEIGHT, NET_X, TABLE_LENGTH, TABLE_WIDTH
from tt_core.flight import fly
from tt_core.states import BallState
from tt_sim.cameras.tracking_cameras import Sightings, believed
from tt_sim.world.outcome import Outcome, free_flight_positions
from tt_sim.world.true_ball import Contact, Surface
from tt_vision.camera import triangulate
from tt_vision.rig import WIDE_RATE

KINK = 1.2  # m/s, least change of velocity at a contact: five standard deviations of positions with 1.3 mm; few bounces give less
UNUSUAL = 4.0  # least change of velocity at a contact over the median change, for worse cameras
TOUCH_DISTANCE = 0.05  # m, distance at which a surface counts as touched: half of the motion between two frames
LEAST_POSITIONS = 5  # least number of positions of a flight
SCATTER = 2.0e-3  # m, standard deviation of a position, for the weight of PRIOR_SPIN: that of bad cameras
FIRST_SPAN = 3  # frames over which the first estimate of the velocity is taken
PRIOR_SPIN = 300.0  # rad/s, prior standard deviation of the spin of any ball: bounds the part that the flight does not show
MOST_PLAYED_SPIN = 1500.0  # rad/s, largest spin about each axis that is considered; real play stays below it
ITERATIONS, JACOBIAN_ITERATIONS = 5, 3  # number of Gauss-Newton iterations, and of the first ones that compute the Jacobian


@njit(cache=True)
def fitted(times: Array, seen: Array, air: Array) -> Array:
    """Fit a flight to observed positions by least squares, with a prior of PRIOR_SPIN.

    Args:
        times: (n,) s, n at least 4.
        seen: (n, 3) m in `table`, observed positions.
        air: (8,) coefficients of the air, `Aerodynamics.coefficients`.

    Returns:
        (9,) position (m), velocity (m/s), spin (rad/s) of the ball at time 0.
    """
    n = len(times)
    ball, step = np.zeros(9), np.array([0.0, 0.0, 0.0, 1e-3, 1e-3, 1e-3, 1.0, 1.0, 1.0])  # m/s, rad/s
    ball[POSITION], ball[VELOCITY] = seen[0], (seen[FIRST_SPAN] - seen[0]) / (times[FIRST_SPAN] - times[0])
    jacobian, normal = np.zeros((3 * n, 9)), np.zeros((9, 9))
    for k in range(3):
        jacobian[k::3, k] = 1.0  # a position moves with the first position
    for i in range(ITERATIONS):
        path = free_flight_positions(ball, times, air)
        if i < JACOBIAN_ITERATIONS:
            for k in range(3, 9):
                beside = ball.copy()
                beside[k] += step[k]
                jacobian[:, k] = ((free_flight_positions(beside, times, air) - path) / step[k]).reshape(3 * n)
            normal[:] = jacobian.T @ jacobian
            for k in range(6, 9):
                normal[k, k] += (SCATTER / PRIOR_SPIN) ** 2
        right = jacobian.T @ (seen - path).reshape(3 * n)
        for k in range(6, 9):
            right[k] -= (SCATTER / PRIOR_SPIN) ** 2 * ball[k]
        ball += np.linalg.solve(normal, right)
        ball[6:] = np.minimum(np.maximum(ball[6:], -MOST_PLAYED_SPIN), MOST_PLAYED_SPIN)
    return ball


@njit(cache=True)
def kinks(times: Array, seen: Array) -> npt.NDArray[np.int64]:
    """Find the frames that are nearest to contacts, where the velocity of the ball jumps.

    There the velocity changes by more than KINK, by more than UNUSUAL times its median change, and by more than at the LEAST_POSITIONS - 1
    frames on each side.

    Args:
        times: (n,) s, n at least LEAST_POSITIONS.
        seen: (n, 3) m in `table`, observed positions.

    Returns:
        Indices of the frames.
    """
    n = len(times)
    change, kink = np.zeros(n), np.zeros(n, dtype=np.bool_)
    for k in range(2, n - 2):
        before, after = (seen[k] - seen[k - 2]) / (times[k] - times[k - 2]), (seen[k + 2] - seen[k]) / (times[k + 2] - times[k])
        change[k] = np.sqrt(((after - before) ** 2).sum())
    least = max(KINK, UNUSUAL * np.median(change[2 : n - 2]))
    for k in range(2, n - 2):
        kink[k] = change[k] > least and change[k] == change[max(0, k - LEAST_POSITIONS + 1) : k + LEAST_POSITIONS].max()
    return np.flatnonzero(kink)


def _surface(ball: Array, after: Array) -> Surface | None:
    """Return what a ball (9,) met that goes on at velocity `after` (3,) m/s; None if no surface is there."""
    x, y, z = ball[POSITION]
    before = ball[VELOCITY]
    if before[X] < 0.0 < after[X] and x < NET_X - TOUCH_DISTANCE:
        return Surface.RACKET
    over = (
        -TOUCH_DISTANCE < x < TABLE_LENGTH + TOUCH_DISTANCE
        and -TOUCH_DISTANCE < y < TABLE_WIDTH + TOUCH_DISTANCE
        and abs(z) < 2.0 * TOUCH_DISTANCE
    )
    if over and before[Z] < after[Z] and after[Z] > 0.0 and before[X] * after[X] > 0.0:
        return Surface.TABLE
    return Surface.NET if abs(x - NET_X) < 2.0 * TOUCH_DISTANCE and z < NET_HEIGHT + TOUCH_DISTANCE else None


@njit(cache=True)
def _meeting(before: Array, after: Array, apart: float, time: float, air: Array) -> tuple[float, Array, Array]:
    """Find where two flights meet.

    Args:
        before: State (9,) of the earlier flight.
        after: State (9,) of the later one, `apart` s after it.
        apart: s.
        time: s after `before`, near the meeting.
        air: Coefficients of the air.

    Returns:
        Time (s) after `before` when both are nearest, and both states then.
    """
    one, other, shift = before, after, 0.0
    for _ in range(3):
        one, other = fly(before, time, air), fly(after, time - apart, air)
        gap, speed = one[:3] - other[:3], one[3:6] - other[3:6]
        shift = float((gap @ speed) / (speed @ speed))
        time -= shift
    return time + shift, one, other


def score_from_video(sightings: Sightings, air: Array) -> Outcome:
    """Return the result of a ball as far as two cameras have seen it.

    Args:
        sightings: Pixels at which the cameras saw the ball.
        air: (8,) coefficients of the air that the evaluation assumes, `Aerodynamics.coefficients`.

    Returns:
        The flight with its contacts, which are where two fitted flights meet. Without enough positions it has no contacts.
    """
    if len(sightings.times) < LEAST_POSITIONS:
        return Outcome(BallState(0.0, *np.zeros((3, 3))))
    times, seen = sightings.times, triangulate(believed(), sightings.pixels)
    turns = kinks(times, seen)
    if len(turns) == 0:
        return Outcome(BallState(times[0], seen[0], np.zeros(3), np.zeros(3)))
    ends = [-1, *turns.tolist(), len(times)]

    def flight(i: int) -> tuple[float, Array] | None:
        """Fit the flight between kinks i - 1 and i, without their frames: a time (s) and the ball (9,) then; None if it is too short."""
        rows = slice(ends[i] + 1, ends[i + 1])
        if rows.stop - rows.start < LEAST_POSITIONS:
            return None
        return float(times[rows.start]), fitted(times[rows] - times[rows.start], seen[rows], air)

    flights = [flight(i) for i in range(len(turns) + 1)]
    outcome = Outcome(_ball(*(flights[0] or (float(times[0]), np.concatenate([seen[0], np.zeros(6)])))))
    for k, before, after in zip(turns, flights, flights[1:], strict=False):
        if before is None or after is None:
            continue
        (start, earlier), (later_start, later) = before, after
        time, one, other = _meeting(earlier, later, later_start - start, times[k] - start, air)
        surface = _surface(one, other[VELOCITY])
        if surface is not None:
            outcome.contacts.append(Contact(surface, _ball(start + time, one), _ball(start + time, other)))
    if flights[-1] is not None and outcome.hit is not None and outcome.landing is None:
        end = _past_the_table(*flights[-1], float(times[-1]), air)
        outcome.contacts += [Contact(Surface.FLOOR, end, end)] if end is not None else []
    return outcome


def _ball(time: float, row: Array) -> BallState:
    """Return the ball of a row that a kernel has just made."""
    row.flags.writeable = False
    return BallState.trusted(time, row[POSITION], row[VELOCITY], row[SPIN])


def _past_the_table(start: float, ball: Array, time: float, air: Array) -> BallState | None:
    """Return a ball (9,) of `start` (s), last seen at `time` (s), where it falls to the table's height, if that is beside the table."""
    while True:
        row = fly(ball, time - start, air)
        if row[Z] < BALL_RADIUS and row[VZ] < 0.0:
            over = 0.0 < row[X] < TABLE_LENGTH and 0.0 < row[Y] < TABLE_WIDTH
            return None if over else _ball(time, row)
        time += 1.0 / WIDE_RATE
