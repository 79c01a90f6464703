"""Regions in which balls are hit, and so how far the flight of a ball has to be predicted. Lengths in m, frame `table`."""

from __future__ import annotations

from dataclasses import dataclass

from .errors import check_range

LARGEST_WINDOW_COORDINATE = 5.0  # m, of a coordinate


@dataclass(frozen=True)
class HitWindow:
    """Box in which the centre of the ball lies when it is hit, m, frame `table`.

    Raises:
        OutOfRange: A coordinate is beyond LARGEST_WINDOW_COORDINATE, or a lower bound is above its upper bound.
        NotFinite: A coordinate is NaN or infinite.
    """

    x_low: float
    x_high: float
    y_low: float
    y_high: float
    z_low: float
    z_high: float

    def __post_init__(self) -> None:
        """Refuse a box without an inside, or outside the hall."""
        for axis in "xyz":
            high = check_range(f"{axis}_high", getattr(self, f"{axis}_high"), -LARGEST_WINDOW_COORDINATE, LARGEST_WINDOW_COORDINATE)
            check_range(f"{axis}_low", getattr(self, f"{axis}_low"), -LARGEST_WINDOW_COORDINATE, high)


HIT_WINDOWS = {
    # x: to a later strike than the -0.3 of dissertation Section 4.5.1, because a later strike is one that the arm has time for;
    # y: where the PA10 reaches everything from its base; z: from where the racket's edge clears the table
    "near": HitWindow(-0.40, 0.0, 0.25, 1.275, 0.12, 0.55),
    # where the PA10 reaches 99 % of random rackets from its base
    "reachable": HitWindow(-0.70, 0.0, 0.20, 1.325, 0.12, 0.70),
}
RACKET_SPEED = 3.5  # m/s, of the strokes that are offered to an arm whose file states no other; the PA10 reaches 3.0 to 3.7 m/s
PATH_MARGIN = 0.1  # m, by which a path goes on past the last point at which its ball may be hit


def path_end(x_low: float) -> float:
    """Return the x (m) at which the predicted path of a ball may end if the ball is hit at `x_low` (m) or before."""
    return round(x_low - PATH_MARGIN, 9)


PATH_END_X = min(path_end(window.x_low) for window in HIT_WINDOWS.values())  # m, for a ball that is hit in any of the windows
