"""Recorded flights of balls, in frame `table`: from a bag of this system or from the files of the aimy launcher."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tt_core.constants import BALL_RADIUS, TABLE_LENGTH, TABLE_WIDTH
from tt_core.errors import TtError, check_array
from tt_core.ros.bags import Bag
from tt_core.states import Array

FEWEST = 12  # points of a flight worth keeping
ODOMETRY = "nav_msgs/msg/Odometry"
GAP = 0.1  # s without a point, and another flight begins
AIMY_CONTACT = 0.759  # m, height of the ball's centre at its bounce, in the files


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """One ball from a launch, or a hit, to the next hit.

    group: balls of one group were launched alike. times: (n,) s. positions: (n, 3) m. spin: (3,) rad/s at the start, None if not measured.
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
            raise TtError(f"times of a flight of group {self.group} must increase")


def aimy(folder: Path) -> list[Flight]:
    """All launches in the *.hdf5 files of `folder` (github: intelligent-soft-robots/ball_prediction), one group for each file.

    The files have x along the table in the direction of flight, y to the side, z up from the floor, the origin below the launcher's muzzle.
    In `table` the balls fly to -x from the opponent's end, along the middle: x = 2.74 - X, y = 0.7625 - Y, and z = Z - 0.739, which puts
    the centre of a ball in contact at BALL_RADIUS. Where along the table the launcher stood is not told, and matters to no result here.
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
        raise TtError(f"{folder} holds no *.hdf5 file with launches")
    return flights


def bag(path: Path, topic: str) -> list[Flight]:
    """Read all flights to -x from a bag.

    Args:
        path: A bag of any kind that `tt_core.ros.bags` reads.
        topic: A topic of nav_msgs/Odometry.

    Returns:
        The flights, cut where the ball turns round or is not seen for GAP. The spin is that of a flight's first message.

    Raises:
        BagError: If the bag cannot be read.
        TtError: If the topic has another type.
    """
    rows = []
    with Bag(path) as opened:
        for kind in {known.kind for known in opened.topics if known.name == topic} - {ODOMETRY}:
            raise TtError(f"{topic} in {path} has the type {kind}, not {ODOMETRY}")
        for message in opened.messages([topic]):
            ball = opened.decode(message)
            time, position, twist = ball.header.stamp, ball.pose.pose.position, ball.twist.twist
            v, w = twist.linear, twist.angular
            rows.append([time.sec + 1e-9 * time.nanosec, position.x, position.y, position.z, v.x, w.x, w.y, w.z])
    return cut(np.array(rows).reshape(-1, 8), path.stem)


def cut(rows: Array, group: str) -> list[Flight]:
    """Flights to -x in rows (n, 8) of time, position, velocity x, spin; of rows of one time the first counts."""
    rows = rows[np.concatenate([[True], np.diff(rows[:, 0]) > 0.0])] if len(rows) else rows
    new = np.flatnonzero((np.diff(rows[:, 0]) > GAP) | (np.diff(np.sign(rows[:, 4])) != 0.0)) + 1
    pieces: Iterable[Array] = np.split(rows, new)
    return [Flight(group, p[:, 0], p[:, 1:4], p[0, 5:]) for p in pieces if len(p) >= FEWEST and p[0, 4] < 0.0]


def load(path: Path, topic: str) -> list[Flight]:
    """From a folder of *.hdf5 or a bag. Raises TtError when there is no flight."""
    flights = aimy(path) if path.is_dir() and any(path.glob("*.hdf5")) else bag(path, topic)
    if not flights:
        raise TtError(f"{path} holds no flight of at least {FEWEST} points on {topic}")
    return flights
