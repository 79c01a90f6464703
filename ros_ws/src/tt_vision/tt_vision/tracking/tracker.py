"""The tracker: it takes measurements of the ball and tells the state of the ball at any time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from tt_core.arrays import POSITION, SPIN, VELOCITY, Z
from tt_core.constants import BALL_RADIUS, FLOOR_Z
from tt_core.errors import BadChoice, TtError, check_array, check_range
from tt_core.events import LARGEST_COORDINATE, LARGEST_SPEED_SUM, LONGEST_PATH
from tt_core.factors import scaled
from tt_core.physics import Physics
from tt_core.states import Array, BallState
from tt_core.tangents import DRAG, PARAMETERS

from ..camera import Camera
from . import cold_start
from .history import MEASURED_POSITION as A_POSITION
from .history import History, Measurements
from .params import TrackerParams
from .prediction import predict
from .window_fit import Prior, Workspace, fit_window, invert, shift, workspace

BATCH = 16  # number of measurements that are added to the fit at a time
RECENT = 8  # number of newest measurements that are checked; if MISSED of them do not fit, another ball is looked for
MISSED = 6
OTHER_SPINS = (0.0, 0.5, 1.5, -0.5)  # factors on the fitted spin that give other starting values for a bad fit
FARTHEST_START = 10.0  # largest distance of such a start from the prior, in standard deviations of the prior
LONGEST_SILENCE = 0.5  # s; a measurement that comes later than this after the newest one may be of another ball, and is kept apart at first
WINDOW_SLACK = 0.05  # s, by which the window may become longer than its lag before its start moves
WIDEST_PLACE = 30.0  # m, standard deviation of each coordinate of a ball before any measurement
LEAST_VARIANCES = np.repeat([1e-10, 1e-8, 1e-4], 3)  # m^2, (m/s)^2, (rad/s)^2, added to those of a measured ball, so that its covariance
# can be inverted
MOST_SPIN = 1e4  # rad/s, largest spin component of a measured ball
UNKNOWN_BALL = np.repeat([0.02, 0.3, 100.0], 3) ** 2  # m^2, (m/s)^2, (rad/s)^2: variances of a ball that is given without a covariance
LATEST_STAMP = 1e12  # s, largest absolute value of a stamp


class NotACovariance(TtError):
    """Error: a matrix is not a covariance, because it is not symmetric or has a negative (or zero) eigenvalue."""

    def __init__(self, name: str, eigenvalue: float) -> None:
        """Keep the values.

        Args:
            name: Name of the argument.
            eigenvalue: Smallest eigenvalue of the matrix; NaN if it is not symmetric.
        """
        super().__init__(f"{name} is not a covariance: smallest eigenvalue {eigenvalue:g}")
        self.name, self.eigenvalue = name, eigenvalue


@dataclass(frozen=True, slots=True)
class TrackCounts:
    """Counts of what the tracker has done since it was created.

    Attributes:
        taken: Measurements that were taken into the window.
        late: Measurements that were refused because they are older than the window.
        restarts: How often another ball was found, because the newest measurements did not fit the track or were outside the window.
        balls: How many balls were followed: started from a measured ball, or found in measurements.
    """

    taken: int = 0
    late: int = 0
    restarts: int = 0
    balls: int = 0


@dataclass(slots=True, eq=False)
class _Track:
    """The track of one ball: prior, estimate, and results of the fit.

    Attributes:
        prior: What was known before the measurements in the window.
        unknowns: (n,) estimate at the start of the window, see `window_fit`.
        space: Results of the fit for each measurement, and the covariance.
        excess: Factor by which the variances of the measurements are larger than given; NaN if the fit has failed.
    """

    prior: Prior
    unknowns: Array
    space: Workspace
    excess: float = 1.0

    @property
    def is_unannounced(self) -> bool:
        """Whether the ball was found in measurements, not started from a measured ball, and the start of its window has not moved yet."""
        return bool(self.prior.spin_shape[0, 0] > 0.0)


class Tracker:
    """Estimates the state of one ball over time from measurements.

    A track starts from a measured state of a ball (`start`), or is found in measured positions or pixels alone. Measurements may arrive in
    any order; each one counts at the time of its stamp. Measurements older than the window, whose length is `TrackerParams.lag`, are
    refused. Nothing is fitted before a result is asked for.
    """

    def __init__(self, physics: Physics, cameras: Sequence[Camera] = (), params: TrackerParams | None = None) -> None:
        """Create a tracker that follows no ball yet.

        Args:
            physics: Models of air and table.
            cameras: The cameras whose pixels will be given to `add_pixel`.
            params: Parameters; None for the defaults.
        """
        self.params = TrackerParams() if params is None else params
        self.counts = TrackCounts()
        self._models, self._physics = physics, physics.coefficients
        self._cameras = np.array([camera.vector for camera in cameras]).reshape(-1, 20)
        self._unknowns = PARAMETERS + (2 * len(self._cameras) if self.params.camera_bias > 0.0 else 0)
        self._noise = np.array([self.params.acceleration_noise**2, self.params.spin_noise**2, self.params.bounce_noise])
        self._broad = np.array([*3 * (self.params.spin_spread,), self.params.drag_spread, self.params.lift_spread])
        self._history, self._outside = History(), History()
        self._track: _Track | None = None
        self._known = self._changed = False
        self._latest = -math.inf  # s, of the last measurement that is used
        self._fitted = -math.inf  # s, of the last one that was fitted or refused

    def use(self, physics: Physics) -> None:
        """Use other models of air and table from now on; call `start` next, so that they do not change in the middle of a track.

        Args:
            physics: Models of air and table.
        """
        self._models, self._physics = physics, physics.coefficients

    def start(self, ball: BallState) -> None:
        """Start a new track from a measured ball. Measurements after its time are kept, earlier ones are forgotten.

        Args:
            ball: State of the ball in `table`. If it has no covariance, the variances UNKNOWN_BALL of a rough guess are used.

        Raises:
            NotACovariance: The covariance is not symmetric, or has a negative eigenvalue.
            OutOfRange: Time, position, velocity or spin is too large for a ball.
        """
        check_range("time", ball.time, -LATEST_STAMP, LATEST_STAMP)
        for name, values, most in (
            ("position", ball.position, LARGEST_COORDINATE),
            ("velocity", ball.velocity, LARGEST_SPEED_SUM),
            ("spin", ball.spin, MOST_SPIN),
        ):
            check_range(name, float(np.abs(values).max()), 0.0, most)
        covariance = np.diag(UNKNOWN_BALL) if ball.covariance is None else _covariance("covariance", ball.covariance, (9, 9), -1e-9)
        motion = np.concatenate([ball.velocity, self._models.air.acceleration(ball.velocity, ball.spin), np.zeros(3)])
        covariance = covariance + self.params.clock_spread**2 * np.outer(motion, motion)
        history = self._history
        kept = int(np.searchsorted(history.measurements.times, ball.time))
        history.drop(kept)
        history.measurements.used[:] = False
        if len(history) and history.measurements.times[-1] > ball.time + LONGEST_PATH:
            history.clear()
        self._outside.clear()
        self._begin(ball.time, ball.vector, covariance + np.diag(LEAST_VARIANCES), np.zeros((3, 3)))
        self._known, self._changed, self._latest, self._fitted = True, True, ball.time, ball.time
        self.counts = replace(self.counts, balls=self.counts.balls + 1)

    def add_position(self, time: float, position: Array, covariance: Array) -> None:
        """Add a measured position of the ball.

        Args:
            time: s, when the ball was there.
            position: (3,) m in `table`.
            covariance: (3, 3) m^2, of the position.

        Raises:
            NotACovariance: `covariance` is not symmetric, or not positive definite.
            NotFinite: A number is NaN or infinite.
            BadShape: An array has another shape.
            OutOfRange: The time exceeds LATEST_STAMP, or a coordinate exceeds LARGEST_COORDINATE.
        """
        time = check_range("time", time, -LATEST_STAMP, LATEST_STAMP)
        position = check_array("position", position, (3,))
        check_range("position", float(np.abs(position).max()), 0.0, LARGEST_COORDINATE)
        matrix = _covariance("covariance", covariance, (3, 3), 0.0)
        self._add(time, A_POSITION, position, np.linalg.inv(np.linalg.cholesky(matrix)))

    def add_pixel(self, time: float, camera_index: int, pixel: Array, sigma: float) -> None:
        """Add a pixel at which a camera sees the ball.

        Args:
            time: s, when the image was taken.
            camera_index: Index in the `cameras` that were given when the tracker was created.
            pixel: (2,) pixels, column u and row v of the ball's centre.
            sigma: Standard deviation of each coordinate, pixels.

        Raises:
            BadChoice: There is no such camera.
            NotFinite: A number is NaN or infinite.
            BadShape: `pixel` has another shape.
            OutOfRange: The time exceeds LATEST_STAMP, `sigma` is outside 1e-4 to 1e4 pixels, or a pixel coordinate exceeds 1e5.
        """
        time = check_range("time", time, -LATEST_STAMP, LATEST_STAMP)
        if isinstance(camera_index, bool) or camera_index not in range(len(self._cameras)):
            raise BadChoice("camera_index", str(camera_index), tuple(map(str, range(len(self._cameras)))))
        pixel = check_array("pixel", pixel, (2,))
        check_range("pixel", float(np.abs(pixel).max()), 0.0, 1e5)
        root = np.zeros((3, 3))
        root[0, 0] = 1.0 / check_range("sigma", sigma, 1e-4, 1e4)
        self._add(time, int(camera_index), np.append(pixel, 0.0), root)

    def state(self, time: float | None = None) -> BallState | None:
        """Return the state of the ball at a time, with its covariance. Bounces on the table are predicted; net and racket are ignored.

        Args:
            time: s; None for the time of the last measurement that is used.

        Returns:
            The ball, or None: while it is not known well enough, before the window of measurements, more than LONGEST_PATH after the last
            one, and below the floor.

        Raises:
            NotFinite: The time is NaN or infinite.
        """
        time = None if time is None else check_range("time", time, -math.inf, math.inf)
        self._update()
        track = self._track
        if track is None or not self._known:
            return None
        at = max(self._latest, track.prior.time) if time is None else time
        if not track.prior.time <= at <= max(self._latest, track.prior.time) + LONGEST_PATH:
            return None
        return self._predict(track, at)

    @property
    def physics(self) -> Physics:
        """The models of air, table and racket, multiplied by the factors that were estimated for the present ball.

        Without a ball they are the models as given.
        """
        self._update()
        if self._track is None or not self._known:
            return self._models
        return scaled(self._models, self._track.unknowns[DRAG:PARAMETERS])

    @property
    def factors(self) -> tuple[Array, Array] | None:
        """How the present ball and the table differ from the models; None if there is no ball.

        These are the logarithms (5,) of the estimated factors on drag and lift of the ball, and on restitution, friction and grip of the
        table, and their covariance (5, 5).
        """
        self._update()
        if self._track is None or not self._known:
            return None
        part = slice(DRAG, PARAMETERS)
        return self._track.unknowns[part].copy(), self._track.space.covariance[part, part].copy()

    def _predict(self, track: _Track, at: float) -> BallState | None:
        """Return the state of the ball at a time.

        Args:
            track: The track of the ball.
            at: s, not before the start of the window.

        Returns:
            The ball; None if its state is not finite or it would be below the floor.
        """
        duration, unseen = at - track.prior.time, at - self._latest
        state, covariance = predict(track.unknowns, track.space.covariance, duration, unseen, self._physics, self._noise, self._broad)
        if not (np.isfinite(state).all() and np.isfinite(covariance).all()) or state[Z] < FLOOR_Z + 0.5 * BALL_RADIUS:
            return None
        return BallState(at, state[POSITION], state[VELOCITY], state[SPIN], covariance)

    def _begin(self, time: float, state: Array, covariance: Array, spin_shape: Array) -> _Track:
        """Start a new track.

        Args:
            time: s, start of its window.
            state: (9,) position m, velocity m/s, spin rad/s in `table` at that time.
            covariance: (9, 9) of the state.
            spin_shape: (3, 3), see `Prior`.
        """
        mean, full = np.zeros(self._unknowns), np.zeros((self._unknowns, self._unknowns))
        mean[:9], full[:9, :9] = state, covariance
        spreads = np.concatenate([self.params.factor_spreads, np.full(self._unknowns - PARAMETERS, self.params.camera_bias)])
        full[9:, 9:] = np.diag(spreads**2)
        space = workspace(self._unknowns)
        space.covariance[:] = full
        prior = Prior(time, mean, invert(full), spin_shape, self.params.spin_spread**2, self.params.spin_weight)
        self._track = _Track(prior, mean.copy(), space)
        return self._track

    def _add(self, time: float, camera: int, value: Array, root: Array) -> None:
        """Add a valid measurement to the window; if its stamp is outside, add it to those of a possible other ball. See `History.add`."""
        times = self._history.measurements.times
        newest = max(times[-1] if len(times) else -math.inf, self._latest)
        track, oldest = self._track, newest - self.params.lag
        if track is not None and (oldest > track.prior.time or not track.is_unannounced):
            oldest = track.prior.time
        if track is not None and oldest <= time < track.prior.time:  # the ball was seen before the start of its track: find it anew
            self._track, self._known, self._latest, self._fitted = None, False, -math.inf, -math.inf
        if oldest <= time <= newest + LONGEST_SILENCE or not math.isfinite(newest):
            self._outside.clear()
            self._take(time, camera, value, root)
            return
        # The measurement is late, or it is the first of another ball or after the clock was set; the latter agree with each other.
        late = time < oldest
        self.counts = replace(self.counts, late=self.counts.late + late)
        self._outside.add(time, camera, value, root)
        beside = self._outside.measurements
        self._outside.drop(int(np.searchsorted(beside.times, beside.times[-1] - cold_start.SPAN)))
        self._outside.drop(len(self._outside) // 2 if self._outside.full else 0)
        if self._from_parabola(self._outside, 0, len(self._outside)):
            self.counts = replace(self.counts, restarts=self.counts.restarts + 1)

    def _take(self, time: float, camera: int, value: Array, root: Array) -> None:
        if self._history.full:
            self._make_room()
        if self._history.add(time, camera, value, root):
            self._changed = True
            self.counts = replace(self.counts, taken=self.counts.taken + 1)

    def _make_room(self) -> None:
        """Remove the older half of the measurements if the window is full; a track keeps what they tell in its prior."""
        self._update()
        half = len(self._history) // 2
        if self._history.full:
            if self._track is not None and self._known:
                self._shift(float(self._history.measurements.times[half]))
            else:
                self._history.drop(half)

    def _update(self) -> None:
        """Fit the track to all new measurements, BATCH at a time in order of their stamps; find a ball first if there is no track."""
        if not self._changed:
            return
        self._changed = False
        while self._known or self._find():
            times = self._history.measurements.times
            end = min(len(times), int(np.searchsorted(times, self._fitted, side="right")) + BATCH)
            if self._fit(end):
                self._doubt(end)
                if self._latest - self._track_start() > self.params.lag + WINDOW_SLACK:
                    self._shift(self._latest - self.params.lag)
            else:
                self._known, self._track = False, None
            times = self._history.measurements.times
            if self._known and (len(times) == 0 or times[-1] <= self._fitted):
                return

    def _track_start(self) -> float:
        """Return the time (s) of the start of the window; minus infinity without a track."""
        return self._track.prior.time if self._track is not None else -math.inf

    def _fit(self, end: int) -> bool:
        """Fit the track to the first `end` measurements; return whether there is a track and its fit has succeeded."""
        track = self._track
        if track is None:
            return False
        seen, before = self._history.part(0, end), track.excess
        track.excess = self._fit_from(track, seen)
        if track.excess > before:
            self._fit_again(track, seen)
        if math.isnan(track.excess):
            return False
        used = seen.times[seen.used]
        self._latest = max(track.prior.time, float(used[-1]) if len(used) else -math.inf)
        self._fitted = max(track.prior.time, float(seen.times[-1]) if end else -math.inf)
        return True

    def _fit_from(self, track: _Track, seen: Measurements) -> float:
        """Fit a track to measurements, starting from its present unknowns; return the new `excess`, NaN if the fit fails."""
        return fit_window(track.unknowns, track.prior, seen, self._cameras, self._physics, self.params.gates, track.space, track.excess)

    def _fit_again(self, track: _Track, seen: Measurements) -> None:
        """Repeat a fit from other spins, and keep the best result: the cost has two minima, slip and grip at a bounce on the table."""
        best, spin = track, track.unknowns[SPIN].copy()
        for share in OTHER_SPINS:
            trial = _Track(track.prior, track.unknowns.copy(), workspace(self._unknowns))
            trial.space.covariance[:] = track.space.covariance
            trial.unknowns[SPIN] = share * spin
            trial.unknowns[DRAG:PARAMETERS] = track.prior.mean[DRAG:PARAMETERS]
            off = trial.unknowns - track.prior.mean
            if off @ track.prior.information @ off > FARTHEST_START**2:
                continue
            seen.used[:] = True
            trial.excess = self._fit_from(trial, seen)
            if trial.excess < best.excess or math.isnan(best.excess):
                best = trial
        track.unknowns, track.space, track.excess = best.unknowns, best.space, best.excess
        seen.used[:] = True
        track.excess = self._fit_from(track, seen)

    def _find(self) -> bool:
        """Look for a ball, from the oldest measurements on; remove measurements that belong to none. Return whether a ball was found."""
        while True:
            times = self._history.measurements.times
            last = cold_start.count_within(times)
            if self._from_parabola(self._history, 0, last):
                return True
            if last == len(times):  # more may come
                return False
            self._history.drop(max(1, last // 4))

    def _doubt(self, end: int) -> None:
        """Look for another ball if most of the newest RECENT of the first `end` measurements do not fit the track."""
        seen = self._history.part(0, end)
        if end < RECENT or np.count_nonzero(~seen.used[-RECENT:]) < MISSED:
            return
        first = end - RECENT
        while first > 0 and not seen.used[first - 1] and cold_start.count_within(seen.times[first - 1 :]) > end - first:
            first -= 1
        kept = seen.used.copy()
        if self._from_parabola(self._history, first, end):
            self.counts = replace(self.counts, restarts=self.counts.restarts + 1)
        else:
            seen.used[:] = kept

    def _from_parabola(self, source: History, first: int, last: int) -> bool:
        """Start a track from a ball that is found in some measurements.

        If a ball is found, measurements before it are forgotten and later ones are kept. If not, only `used` of these measurements changes.

        Args:
            source: The measurements.
            first: Index of the first one that is searched.
            last: Index after the last one that is searched.

        Returns:
            Whether a ball was found.
        """
        parabola = cold_start.find_ball_motion(source.part(first, last), self._cameras)
        if parabola is None:
            return False
        seen = source.part(first, last)
        before = (self._track, self._known, self._latest, self._fitted, self._history)
        start = first + int(np.argmax(seen.used))
        self._track, self._history = None, source.copy(start)
        self._history.measurements.used[last - start :] = False
        params = self.params
        direction = parabola[3:] / max(1e-9, float(np.linalg.norm(parabola[3:])))
        shape = np.eye(3) + (1.0 / params.spin_along**2 - 1.0) * np.outer(direction, direction)
        covariance = np.diag(np.repeat([WIDEST_PLACE, params.speed_spread, 0.0], 3) ** 2)
        covariance[SPIN, SPIN] = params.spin_spread**2 * np.linalg.inv(shape)
        track = self._begin(float(self._history.measurements.times[0]), np.concatenate([parabola, np.zeros(3)]), covariance, shape)
        track.space.covariance[:] = 0.0  # so that at first only measurements that agree with the parabola are used
        if self._fit(last - start) and self._is_known(track):
            self._known = True
            self._outside.clear()
            self.counts = replace(self.counts, balls=self.counts.balls + 1)
            return True
        self._track, self._known, self._latest, self._fitted, self._history = before
        return False

    def _is_known(self, track: _Track) -> bool:
        """Return whether position and velocity at the last measurement are accurate enough to be told, see `TrackerParams`."""
        ball = self._predict(track, self._latest)
        if ball is None or ball.covariance is None:
            return False
        place, speed = (math.sqrt(float(np.trace(ball.covariance[part, part]))) for part in (POSITION, VELOCITY))
        return place < self.params.known_position and speed < self.params.known_speed

    def _shift(self, until: float) -> None:
        """Move the start of the window to the time `until` (s), and put what the older measurements tell into the prior."""
        track = self._track
        if track is None:
            return
        gone = int(np.searchsorted(self._history.measurements.times, until))
        track.prior = shift(
            track.unknowns,
            track.prior,
            until,
            self._history.part(0, gone),
            self._physics,
            self._noise,
            track.space,
            track.excess,
        )
        self._history.drop(gone)


def _covariance(name: str, value: Any, shape: tuple[int, int], least: float) -> Array:
    """Check a covariance and return it as an array.

    Args:
        name: Name of the argument, for the error.
        value: The covariance.
        shape: Its shape.
        least: The smallest eigenvalue must be more than `least` times the largest one. With 0 the matrix must be positive definite; with a
            small negative number rounding errors and the zero matrix are accepted.

    Raises:
        NotACovariance: The matrix is not symmetric, or its smallest eigenvalue is too small.
    """
    matrix = check_array(name, value, shape)
    scale = float(np.abs(matrix).max())
    if scale == 0.0 and least < 0.0:
        return matrix
    if not np.abs(matrix - matrix.T).max() <= 1e-6 * scale:
        raise NotACovariance(name, math.nan)
    values = np.linalg.eigvalsh(0.5 * (matrix + matrix.T))
    if not values[0] > least * max(abs(values[-1]), 1e-300) or (least == 0.0 and values[0] <= 1e-16):
        raise NotACovariance(name, float(values[0]))
    return matrix


__all__ = ["NotACovariance", "TrackCounts", "Tracker"]
