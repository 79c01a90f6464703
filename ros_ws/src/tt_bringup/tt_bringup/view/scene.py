"""The present state of table, arm and ball as far as it is known, and the items (simple shapes) that show it.

Everything gets a time of arrival by the clock of the caller. It is not shown any more when it is older than its lifetime. Stamps may be of
another clock than arrivals, as when a bag is played: the difference of both is taken from the newest message of a frequent topic.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np
from tt_core.arrays import Array
from tt_core.constants import (
    BALL_RADIUS,
    NET_HEIGHT,
    NET_OVERHANG,
    NET_X,
    RACKET_RADIUS,
    TABLE_LENGTH,
    TABLE_THICKNESS,
    TABLE_WIDTH,
)
from tt_core.errors import TtError
from tt_core.physics import Physics
from tt_core.states import BallPath, BallState, RacketState, ReturnGoal
from tt_predict.uncertainty import covariances

from .items import Colour, Item, arrow, ball, box, disc, ellipsoid, line
from .robot_shapes import RobotShapes

T = TypeVar("T")

BALL_LIFETIME = 0.5  # s for which the true ball is shown after its last state
PATH_LIFETIME = 2.0  # s for which a path is shown after its end, and strokes after the strike
LANDING_LIFETIME = 6.0  # s for which a landing is shown
TRAIL = 1.2  # s, length of the trail of the true ball
TRAIL_POINTS = 400  # most points of this trail
ELLIPSOIDS = 8  # number of ellipsoids along a path
ELLIPSOID_SIGMAS = 3.0  # half axes of an ellipsoid in standard deviations
STROKES = 6  # most candidate strokes that are shown
SPIN_LENGTH = 1e-3  # m, length of the spin's arrow for 1 rad/s
SAME_CLOCK = 5.0  # s between stamp and arrival, above which they are taken to be of different clocks
MATCH = 1e-5  # s, largest difference between the time of a state and the start of the path predicted from it
STATES = 32  # number of newest states that are kept, because the tracker may send several before the path of one arrives

BLUE: Colour = (0.09, 0.29, 0.46, 1.0)
WHITE: Colour = (0.95, 0.95, 0.95, 1.0)
NET_COLOUR: Colour = (0.85, 0.85, 0.85, 0.45)
ORANGE: Colour = (0.95, 0.55, 0.1, 1.0)  # the true ball
CYAN: Colour = (0.1, 0.7, 0.75, 0.8)  # the estimated ball
PALE: Colour = (0.1, 0.7, 0.75, 0.2)  # its uncertainty
GREEN: Colour = (0.2, 0.7, 0.3, 0.8)  # the best stroke
FAINT: Colour = (0.2, 0.7, 0.3, 0.25)  # other strokes
MAGENTA: Colour = (0.8, 0.25, 0.65, 0.9)  # the landing that is asked for
YELLOW: Colour = (0.95, 0.85, 0.2, 0.9)  # the landing that was reached


def table_items() -> list[Item]:
    """Return the items that show the table with its lines, and the net."""
    width, above = 0.02, 1e-3  # m, width of a line (ITTF laws 2.1), and its height above the surface, so that it is visible
    corners = np.array([[0, 0], [TABLE_LENGTH, 0], [TABLE_LENGTH, TABLE_WIDTH], [0, TABLE_WIDTH], [0, 0]], float)
    inner = np.clip(corners, 0.5 * width, np.array([TABLE_LENGTH, TABLE_WIDTH]) - 0.5 * width)
    middle = np.array([[0.0, 0.5 * TABLE_WIDTH, above], [TABLE_LENGTH, 0.5 * TABLE_WIDTH, above]])
    centre = (0.5 * TABLE_LENGTH, 0.5 * TABLE_WIDTH, -0.5 * TABLE_THICKNESS)
    return [
        box("table/top", BLUE, (TABLE_LENGTH, TABLE_WIDTH, TABLE_THICKNESS), centre),
        line("table/edges", WHITE, np.column_stack([inner, np.full(5, above)]), width),
        line("table/middle", WHITE, middle, 0.15 * width),
        box("table/net", NET_COLOUR, (0.01, TABLE_WIDTH + 2.0 * NET_OVERHANG, NET_HEIGHT), (NET_X, 0.5 * TABLE_WIDTH, 0.5 * NET_HEIGHT)),
    ]


def warm(physics: Physics) -> None:
    """Load the compiled kernels that a scene uses, so that no drawing waits for them. physics: models of flight and rebounds."""
    ball = BallState(0.0, np.array([2.0, 0.7, 0.3]), np.array([-5.0, 0.0, 1.0]), np.zeros(3), 1e-6 * np.eye(9))
    covariances(ball, physics, np.array([0.1]))
    BallPath(np.zeros(1), ball.position[None], ball.velocity[None], ball.spin[None]).at(0.0)


@dataclass(slots=True)
class Timed(Generic[T]):
    """A value with the time of arrival (s) until which it is shown."""

    value: T
    until: float


@dataclass(slots=True)
class ShownJoints:
    """A joint state.

    Attributes:
        positions: Position of each joint by name, rad or m.
        speeds: Speed of each joint by name, rad/s or m/s; empty if speeds are not known.
    """

    positions: Mapping[str, float] = field(default_factory=dict)
    speeds: Mapping[str, float] = field(default_factory=dict)


class DrawnScene:
    """Everything that is drawn in 3D: table, arm, ball, predicted path, strokes, landing places.

    The `take_...` methods give it new data. In all of them `now` is the time of arrival, s.

    Attributes:
        robot: Shapes of the arm.
        joints: The newest joint state.
        goal: The newest goal of the return; None before the first.
    """

    def __init__(self, robot: RobotShapes, physics: Physics) -> None:
        """Begin with the table and the arm, and no ball.

        Args:
            robot: Shapes of the arm.
            physics: Models of flight and rebounds with which the uncertainty along a predicted path is computed.
        """
        self._physics, self._table = physics, table_items()
        self.goal: ReturnGoal | None = None
        self.take_robot(robot)
        self.forget()

    def forget(self) -> None:
        """Forget everything that has a lifetime, as before the first message. Robot, joint state and goal stay."""
        self._lag, self._latest = 0.0, -np.inf  # s, arrival minus stamp; s, newest arrival
        self._states = deque[BallState](maxlen=STATES)
        self._true: Timed[BallState] | None = None
        self._trail = deque[BallState](maxlen=TRAIL_POINTS)
        self._path: Timed[BallPath] | None = None
        self._path_items: list[Item] = []
        self._strokes: Timed[list[Item]] | None = None
        self._landing: Timed[Array] | None = None

    def take_robot(self, robot: RobotShapes) -> None:
        """Show another arm, at its neutral posture until joint states arrive. robot: its shapes."""
        self.robot, self.joints = robot, ShownJoints()
        self._arm = robot.items({})

    def take_joints(self, stamp: float, joints: ShownJoints, now: float) -> None:
        """Show the arm at a joint state.

        Args:
            stamp: Stamp of the joint state, s.
            joints: The joint state.
            now: Time of arrival, s.
        """
        self._follow(stamp, now, is_frequent=True)
        if joints.positions != self.joints.positions:
            self._arm = self.robot.items(joints.positions)
        self.joints = joints

    def take_true_ball(self, state: BallState, now: float) -> None:
        """Show the true ball, as the simulator publishes it, with a trail of its last TRAIL s."""
        self._follow(state.time, now, is_frequent=True)
        if self._trail and not 0.0 <= state.time - self._trail[-1].time < BALL_LIFETIME:
            self._trail.clear()  # another ball
        self._trail.append(state)
        while state.time - self._trail[0].time > TRAIL:
            self._trail.popleft()
        self._true = Timed(state, now + BALL_LIFETIME)

    def take_estimate(self, state: BallState, now: float) -> None:
        """Keep a measured or tracked state of the ball; its covariance is used for the path that is predicted from it."""
        self._follow(state.time, now)
        self._states.append(state)

    def take_path(self, path: BallPath, now: float) -> None:
        """Show a predicted path of the ball, with its bounces and, if the covariance at its start is known, its uncertainty."""
        self._follow(path.times[0], now)
        self._path = Timed(path, path.times[-1] + self._lag + PATH_LIFETIME)
        self._path_items = [line("path/ahead", CYAN, path.positions, 0.006), *self._uncertainty(path)]
        self._path_items += [ball(f"path/bounce{i}", CYAN, 0.012, bounce.position) for i, bounce in enumerate(path.bounces)]

    def take_strokes(self, rackets: Sequence[RacketState], stamp: float, now: float) -> None:
        """Show candidate strokes: rackets at the time at which they return the ball.

        Args:
            rackets: The candidates, the best first.
            stamp: Time of the camera frame from which they were computed, s.
            now: Time of arrival, s.
        """
        self._follow(stamp, now)
        shown = [item for i, racket in enumerate(rackets[:STROKES]) for item in _stroke(i, racket)]
        until = max((racket.time for racket in rackets), default=stamp)
        self._strokes = Timed(shown, until + self._lag + PATH_LIFETIME)

    def take_goal(self, goal: ReturnGoal) -> None:
        """Show the landing place of a goal of the return, until the next goal."""
        self.goal = goal

    def take_landing(self, place: Array, now: float) -> None:
        """Show where the returned ball landed. place: (3,) m in the frame `table`."""
        self._landing = Timed(np.array(place), now + LANDING_LIFETIME)

    def items(self, now: float) -> list[Item]:
        """Return the items that are to be drawn at the time `now` (s, by the clock of the arrivals)."""
        if now < self._latest - SAME_CLOCK:  # the clock has been set back: a bag begins again
            self.forget()
        found = [*self._table, *self._arm]
        if self._true is not None and now <= self._true.until:
            found += _spinning("true_ball", ORANGE, self._true.value)
            if len(self._trail) > 1:
                found.append(line("true_ball/trail", ORANGE, np.array([state.position for state in self._trail]), 0.008))
        if self._path is not None and now <= self._path.until:
            found += self._path_items + self._estimated(self._path.value, now - self._lag)
        if self._strokes is not None and now <= self._strokes.until:
            found += self._strokes.value
        if self.goal is not None:
            found.append(disc("landing/asked", MAGENTA, 0.06, 0.004, np.array([*self.goal.landing, 0.004]), np.eye(3)))
        if self._landing is not None and now <= self._landing.until:
            found.append(ball("landing/reached", YELLOW, BALL_RADIUS, self._landing.value))
        return found

    def _follow(self, stamp: float, now: float, *, is_frequent: bool = False) -> None:
        """Update the difference between arrival and stamp (s).

        Messages of frequent topics always update it; the others only if it is off by more than SAME_CLOCK.
        """
        self._latest = now
        if is_frequent or abs(now - stamp - self._lag) > SAME_CLOCK:
            self._lag = now - stamp

    def _estimated(self, path: BallPath, time: float) -> list[Item]:
        """Return the items of the estimated ball at `time` (s, by the clock of the stamps) and of its way since the start of the path.

        The list is empty if the path does not reach to this time.
        """
        if not path.times[0] <= time <= path.times[-1]:
            return []
        state = path.at(time)
        past = np.concatenate([path.positions[path.times <= time], state.position[None]])
        return [*_spinning("estimated_ball", CYAN, state), line("estimated_ball/trail", CYAN, past, 0.012)]

    def _uncertainty(self, path: BallPath) -> list[Item]:
        """Return ellipsoids of the position's uncertainty along a path; an empty list if the covariance at its start is not known."""
        start = next((state for state in reversed(self._states) if abs(state.time - path.times[0]) <= MATCH), None)
        if start is None or start.covariance is None:
            return []
        times = np.linspace(path.times[0], path.times[-1], ELLIPSOIDS + 1)[1:]
        try:
            places = covariances(start, self._physics, times)[:, :3, :3]
        except TtError:  # the covariance cannot be used: the path is drawn without it
            return []
        rows = zip(itertools.count(), times, places, strict=False)
        return [ellipsoid(f"path/uncertainty{i}", PALE, path.at(time).position, place, ELLIPSOID_SIGMAS) for i, time, place in rows]


def _spinning(name: str, colour: Colour, state: BallState) -> list[Item]:
    """Return the items of a ball and of an arrow along its spin, which is left out below 1 rad/s."""
    found = [ball(f"{name}/ball", colour, BALL_RADIUS, state.position)]
    if np.linalg.norm(state.spin) > 1.0:
        found.append(arrow(f"{name}/spin", colour, state.position, state.position + SPIN_LENGTH * state.spin, 0.012))
    return found


def _stroke(index: int, racket: RacketState) -> list[Item]:
    """Return the items of a candidate stroke: the racket at the strike and, for the best one (index 0), an arrow of its velocity.

    The arrow is as long as the way of the racket in 0.1 s.
    """
    colour = FAINT if index else GREEN
    found = [disc(f"strokes/{index}", colour, RACKET_RADIUS, 0.006, racket.position, racket.rotation)]
    if not index and np.linalg.norm(racket.velocity) > 0.01:
        found.append(arrow("strokes/velocity", colour, racket.position, racket.position + 0.1 * racket.velocity, 0.01))
    return found
