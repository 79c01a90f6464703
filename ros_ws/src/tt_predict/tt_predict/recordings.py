"""Read recorded flights of balls, in frame `table`: from a bag of this system or from the files of the aimy ball launcher."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from tt_core.arrays import Array
from tt_core.constants import BALL_RADIUS, TABLE_LENGTH, TABLE_WIDTH
from tt_core.errors import TtError, check_array
from tt_core.ros.bags import Bag

LEAST_FLIGHT_POINTS = 12  # least number of points of a flight; shorter ones are dropped
ODOMETRY = "nav_msgs/msg/Odometry"
FLIGHT_GAP = 0.1  # s without a point, after which another flight begins
AIMY_CONTACT = 0.759  # m, height of the ball's centre at its bounce, in the files


# one message about the ball: time in s, position in m, x of the velocity in m/s, spin in rad/s
BALL_ROW = np.dtype([("time", float), ("position", float, 3), ("velocity_x", float), ("spin", float, 3)])


class BadTimes(TtError):
    """The times of a flight do not increase, or there are fewer than two."""

    def __init__(self, group: str) -> None:
        """Keep the group of the flight."""
        super().__init__(f"times of a flight of group {group} must increase")
        self.group = group


class NoRecordedFlight(TtError):
    """A file or folder holds no recorded flight."""

    def __init__(self, path: Path, wanted: str) -> None:
        """Keep the path."""
        super().__init__(f"{path} holds no {wanted}")
        self.path = path


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """Recorded points of one flight of a ball, from a launch or a hit to the next hit, with the bounces between.

    Attributes:
        group: Name of the group of flights, whose balls were launched in the same way.
        times: (n,) s, increasing.
        positions: (n, 3) m in `table`, of the ball's centre.
        spin: (3,) rad/s in `table`, at the start; None if it was not measured.

    Raises:
        BadShape: An array has another shape.
        NotFinite: A number is NaN or infinite.
        BadTimes: There are less than two points, or the times do not increase.
    """

    group: str
    times: Array
    positions: Array
    spin: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "times", check_array("times", self.times, (-1,)))
        object.__setattr__(self, "positions", check_array("positions", self.positions, (len(self.times), 3)))
        if self.spin is not None:
            object.__setattr__(self, "spin", check_array("spin", self.spin, (3,)))
        if len(self.times) < 2 or (np.diff(self.times) <= 0.0).any():
            raise BadTimes(self.group)


def aimy(folder: Path) -> list[Flight]:
    """Read all launches of the aimy ball launcher from the *.hdf5 files of a folder; each file becomes one group.

    The files are those of github: intelligent-soft-robots/ball_prediction. In them X points along the table in the direction of flight, Y
    to the side and Z up from the floor; the origin is below the launcher's muzzle. In `table` the balls fly to -x from the opponent's end,
    along the middle: x = 2.74 - X, y = 0.7625 - Y, and z = Z - 0.739, with which the centre of a ball is at z = BALL_RADIUS at its bounce.
    The files do not tell where along the table the launcher stood, and no result here depends on it.

    Raises:
        NoRecordedFlight: The folder has no such file.
    """
    import h5py

    flights = []
    for path in sorted(folder.glob("*.hdf5")):
        with h5py.File(path) as file:
            launches = file["originals"]
            for name in sorted(launches, key=int):
                x, y, z = np.asarray(launches[name]["positions"], dtype=float).T
                positions = np.column_stack([TABLE_LENGTH - x, TABLE_WIDTH / 2.0 - y, z - AIMY_CONTACT + BALL_RADIUS])
                flights.append(Flight(path.stem, np.asarray(launches[name]["time_stamps"], dtype=float), positions))
    if not flights:
        raise NoRecordedFlight(folder, "*.hdf5 file with launches")
    return flights


def bag(path: Path, topic: str) -> list[Flight]:
    """Read all flights in which the ball flies to -x (towards the robot) from a bag.

    Args:
        path: A bag of any kind that `tt_core.ros.bags` reads.
        topic: Name of the topic of nav_msgs/Odometry that has the states of the ball.

    Returns:
        The flights, one group named after the bag. A flight ends where the velocity in x changes its sign, or where there is no message for
        more than FLIGHT_GAP seconds. The spin of a flight is that of its first message.

    Raises:
        BagError: The bag cannot be read.
        TtError: The topic has another type.
    """
    rows = []
    with Bag(path) as opened:
        for kind in {known.kind for known in opened.topics if known.name == topic} - {ODOMETRY}:
            raise TtError(f"{topic} in {path} has the type {kind}, not {ODOMETRY}")
        for message in opened.messages([topic]):
            ball = opened.decode(message)
            time, position, twist = ball.header.stamp, ball.pose.pose.position, ball.twist.twist
            v, w = twist.linear, twist.angular
            rows.append((time.sec + 1e-9 * time.nanosec, (position.x, position.y, position.z), v.x, (w.x, w.y, w.z)))
    return cut(np.array(rows, BALL_ROW), path.stem)


def cut(rows: npt.NDArray[Any], group: str) -> list[Flight]:
    """Divide messages about balls into flights, and keep those in which the ball flies to -x (towards the robot).

    Args:
        rows: (n,) elements of BALL_ROW, in the order of time. If several have the same time, the first one is used.
        group: Name of the group to which the flights belong.

    Returns:
        The flights of at least LEAST_FLIGHT_POINTS points. A new one begins where the velocity in x changes its sign, or after more than
        FLIGHT_GAP seconds without a row.
    """
    rows = rows[np.concatenate([[True], np.diff(rows["time"]) > 0.0])] if len(rows) else rows
    new = np.flatnonzero((np.diff(rows["time"]) > FLIGHT_GAP) | (np.diff(np.sign(rows["velocity_x"])) != 0.0)) + 1
    pieces: Iterable[npt.NDArray[Any]] = np.split(rows, new)
    long = [piece for piece in pieces if len(piece) >= LEAST_FLIGHT_POINTS and piece["velocity_x"][0] < 0.0]
    return [Flight(group, piece["time"], piece["position"], piece["spin"][0]) for piece in long]


def load_flights(path: Path, topic: str) -> list[Flight]:
    """Read all recorded flights from a folder of *.hdf5 files of the aimy ball launcher, or from a bag.

    Args:
        path: The folder or the bag.
        topic: Name of the topic of nav_msgs/Odometry that has the states of the ball in a bag.

    Returns:
        The flights, at least one.

    Raises:
        NoRecordedFlight: There is no flight.
        BagError: The bag cannot be read.
        TtError: The topic has another type.
    """
    flights = aimy(path) if path.is_dir() and any(path.glob("*.hdf5")) else bag(path, topic)
    if not flights:
        raise NoRecordedFlight(path, f"flight of at least {LEAST_FLIGHT_POINTS} points on {topic}")
    return flights
