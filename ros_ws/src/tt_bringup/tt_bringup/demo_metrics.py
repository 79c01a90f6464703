"""Metrics of one ball of the demo: what was true, measured, asked for and reached."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import NamedTuple

import numpy as np
from tt_core.constants import RPM
from tt_core.flight import Aerodynamics, fly
from tt_core.states import BallState, ReturnGoal
from tt_sim.world.outcome import Result

SEEN_WITHIN = 0.5  # s, longest time from the launch of a ball to the last camera frame of its measurement


@dataclass(frozen=True)
class DemoMetrics:
    """Metrics of one ball: its true and its measured state, the return that was asked for, and what it did.

    A value is None if the event that it describes did not happen. Vectors are in the frame `table`.

    Attributes:
        kind: Kind and scale of the shot, e.g. "top 3".
        seen: Whether the ball was measured.
        hit: Whether the racket hit the ball.
        landed: Whether the ball was returned to the opponent's half.
        reason: Why the ball was not returned; None if it was.
        speed_true: True speed at the time of the measurement, m/s.
        speed_measured: Measured speed, m/s.
        spin_true: (3,) true spin at the time of the measurement, rad/s; at the launch if that is not known.
        spin_measured: (3,) measured spin, rad/s.
        spin_error_rpm: Length of the difference between measured and true spin, rpm.
        hit_place: (3,) centre of the ball when the racket hit it, m.
        hit_error_m: Distance of the contact from the centre of the racket's face, m.
        landing_asked: (2,) x and y of the landing that was asked for, m.
        landing_reached: (2,) x and y of the landing, m.
        flight_time_asked: Flight time from racket to landing that was asked for, s.
        time_error_s: Flight time minus the one that was asked for, s.
        return_spin_asked: (2,) spin about y and z after the hit that was asked for, rad/s.
        return_spin_reached: (2,) spin about y and z after the hit, rad/s.
        latency_ms: Time from the last camera frame to the first joint command, ms.
    """

    kind: str
    seen: bool
    hit: bool
    landed: bool
    reason: str | None
    speed_true: float | None
    speed_measured: float | None
    spin_true: list[float]
    spin_measured: list[float] | None
    spin_error_rpm: float | None
    hit_place: list[float] | None
    hit_error_m: float | None
    landing_asked: list[float]
    landing_reached: list[float] | None
    flight_time_asked: float
    time_error_s: float | None
    return_spin_asked: list[float]
    return_spin_reached: list[float] | None
    latency_ms: float | None

    def as_dict(self) -> dict[str, object]:
        """Return all metrics as a dictionary, by the names of the attributes."""
        return asdict(self)


def _ball(text: str) -> BallState | None:
    """Return the state of a ball from a JSON row: time (s), position (m), velocity (m/s), spin (rad/s); None from null."""
    row = json.loads(text)
    return BallState.from_vector(row[0], np.array(row[1:])) if row else None


def launched_ball(values: dict[str, str]) -> BallState:
    """Return the true state of a ball at its launch. values: what the simulator reports on /diagnostics of a ball that is over."""
    ball = _ball(values["launched"])
    assert ball is not None
    return ball


def true_ball(values: dict[str, str], time: float, air: Aerodynamics) -> BallState:
    """Return the true state of a ball before its first contact, computed by the model of flight from its launch.

    Args:
        values: What the simulator reports of the ball on /diagnostics when it is over.
        time: Time of the state, s.
        air: Coefficients of the simulated air.
    """
    launched = launched_ball(values)
    return BallState.from_vector(time, fly(launched.vector, time - launched.time, air.coefficients))


def demo_metrics(
    values: dict[str, str],
    goal: ReturnGoal,
    measured: BallState | None,
    latency_ms: float | None,
    refusal: str | None,
    true: BallState | None,
) -> DemoMetrics:
    """Return the metrics of a ball that is over.

    Args:
        values: What the simulator reports of the ball on /diagnostics.
        goal: Return that was asked for.
        measured: The last measured ball. It is ignored if it is of an earlier ball. None if none was measured.
        latency_ms: Time from the last camera frame to the first joint command, ms; None without a command.
        refusal: The last warning of a node during the flight; None without one.
        true: The true ball at the time of the measurement; None if it is not known.
    """
    launched, hit, after, landing = launched_ball(values), *(_ball(values[key]) for key in ("hit", "after_hit", "landing"))
    if measured and not launched.time < measured.time < launched.time + SEEN_WITHIN:
        measured = true = None  # the measurement is of an earlier ball
    result = Result(values["result"])
    reason = None if result is Result.RETURNED else result.value if measured and not refusal else refusal or "not seen"
    spin_true = (true or launched).spin
    return DemoMetrics(
        kind=values["shot"],
        seen=measured is not None,
        hit=hit is not None,
        landed=result is Result.RETURNED,
        reason=reason,
        speed_true=float(np.linalg.norm(true.velocity)) if true else None,
        speed_measured=float(np.linalg.norm(measured.velocity)) if measured else None,
        spin_true=spin_true.tolist(),
        spin_measured=measured.spin.tolist() if measured else None,
        spin_error_rpm=float(np.linalg.norm(measured.spin - spin_true)) / RPM if measured else None,
        hit_place=hit.position.tolist() if hit else None,
        hit_error_m=float(values["offset"]) if hit else None,
        landing_asked=goal.landing.tolist(),
        landing_reached=landing.position[:2].tolist() if landing else None,
        flight_time_asked=goal.flight_time,
        time_error_s=landing.time - hit.time - goal.flight_time if landing and hit else None,
        return_spin_asked=[goal.spin_y, goal.spin_z],
        return_spin_reached=after.spin[1:].tolist() if after else None,
        latency_ms=latency_ms,
    )


class TableColumn(NamedTuple):
    """Two lines of heading of a column, and its width in characters."""

    first: str
    second: str
    width: int


TABLE_COLUMNS = (  # 80 characters with the gaps between them
    TableColumn("ball", "", 7),
    TableColumn("spin, rpm", "true meas.", 10),
    TableColumn("off", "rpm", 3),
    TableColumn("hit", "mm", 4),
    TableColumn("landing", "x, y, m", 9),
    TableColumn("off", "mm", 4),
    TableColumn("time", "ms", 4),
    TableColumn("spin y, z, rad/s", "asked got", 16),
    TableColumn("latency", "ms", 7),
)
TABLE_HEADER = "\n".join(
    "  ".join(f"{line:^{column.width}}" for line, column in zip(lines, TABLE_COLUMNS, strict=True))
    for lines in zip(*((column.first, column.second) for column in TABLE_COLUMNS), strict=True)
)


def table_line(s: DemoMetrics) -> str:
    """Return the metrics of one ball as a line of text whose columns fit TABLE_HEADER.

    A cell is blank if its value is None. The reason why the ball was not returned, if there is one, is a second line.

    Args:
        s: Metrics of the ball.
    """

    def places(v: list[float] | None, form: str, between: str = " ") -> str:
        return "" if v is None else between.join(format(x + 0.0, form) for x in v)

    def number(x: float | None, form: str, scale: float = 1.0) -> str:
        return "" if x is None else format(scale * x, form)

    def pair(one: str, other: str) -> str:
        return f"{one} {other}".strip()

    off = None if s.landing_reached is None else float(np.hypot(*np.subtract(s.landing_reached, s.landing_asked)))
    true, measured = (None if v is None else float(np.linalg.norm(v)) / RPM for v in (s.spin_true, s.spin_measured))
    cells = (
        s.kind,
        pair(number(true, ".0f"), number(measured, ".0f")),
        number(s.spin_error_rpm, ".0f"),
        number(s.hit_error_m, ".1f", 1e3),
        places(s.landing_reached, ".2f"),
        number(off, ".0f", 1e3),
        number(s.time_error_s, ".0f", 1e3),
        pair(places(s.return_spin_asked, ".0f", ","), places(s.return_spin_reached, ".0f", ",")),
        number(s.latency_ms, ".0f"),
    )
    row = "  ".join(f"{cell:^{column.width}}" for cell, column in zip(cells, TABLE_COLUMNS, strict=True))
    return row if s.reason is None else f"{row}\n{'':9}not returned: {s.reason}"
