"""From two streams of images to one burst for each ball: pairs by stamp, the whole ball in both, survives whatever a network does."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from tt_core.errors import BadShape, check_range
from tt_core.params import check, param
from tt_core.states import Array

from ..detection.ball_detection import DetectionReason, Image, Spot, find_ball
from ..measure import LEAST_FRAMES, MOST_FRAMES

SIDES = ("left", "right")
Seen = tuple[Image, Spot] | None  # an image that shows a whole ball, and where; None when it does not
WHOLE_AGAIN = 1.0  # s that stamps may jump back before it is taken as a new recording
MOST_WAITING = 64  # images of a side that wait for their partners: more than a camera of 900 Hz sends in `gap`
MOST_BYTES = 2**27  # of images of a side that wait


@dataclass(frozen=True)
class BurstParams:
    """How a burst is put together."""

    frames: int = param(6, "", "pairs that make a burst; the dissertation uses 6", low=LEAST_FRAMES, high=MOST_FRAMES)
    refined: int = param(0, "", "pairs that make a second burst of the same ball, the first ones among them; 0: none")
    alone: str = param("", "", "side of the only camera that makes the bursts; empty for both", choices=("", *SIDES))
    clock_offset: float = param(0.0, "s", "by which the right camera's clock is behind the left one's", low=-10.0, high=10.0)
    gap: float = param(0.05, "s", "without a ball after which the next one is new", low=0.001, high=10.0)
    pairing: float = param(2e-4, "s", "between the stamps of two images taken together; frames are 1.1e-3 s apart", low=0.0, high=0.1)

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        check(self)
        if self.refined:
            check_range("refined", self.refined, self.frames + 1, MOST_FRAMES)


@dataclass(frozen=True, eq=False)
class Burst:
    """left, right: (k, h, w), both the same of one camera alone. times: (k,) s, rising, of the left camera's clock. spots: [camera][frame],
    looked at as the images came. refined: whether the same ball has had a shorter burst."""

    left: np.ndarray
    right: np.ndarray
    times: Array
    spots: list[list[Spot]]
    refined: bool = False


@dataclass
class Counts:
    """Images that did not make it, since the start. spare: after the burst of their ball was complete. unpaired: their partner did not
    come while they waited, or too many waited."""

    unpaired: int = 0
    duplicate: int = 0
    late: int = 0
    not_whole: int = 0
    spare: int = 0


@dataclass
class Assembler:
    """Takes images in any order; hands out a burst as soon as one is complete, or when its ball leaves with LEAST_FRAMES seen; and another
    one, if wanted, with more frames of the same ball."""

    params: BurstParams = field(default_factory=BurstParams)
    counts: Counts = field(default_factory=Counts)
    _waiting: tuple[deque[tuple[float, Seen]], ...] = field(default_factory=lambda: (deque(), deque()))
    _pairs: list[tuple[float, tuple[Image, Spot], tuple[Image, Spot]]] = field(default_factory=list)
    _kinds: list[tuple | None] = field(default_factory=lambda: [None, None])  # shape and type of the present ball's images
    _last: float = -np.inf  # newest stamp that showed a ball
    _given: int = 0  # bursts that the present ball has had
    _used: int = 0  # pairs in the last of them

    def add(self, side: int, time: float, image: Image) -> Burst | None:
        """side: 0 left, 1 right. time: s, middle of the exposure. image: (h, w) uint8 or uint16.

        Raises TtError for another kind, and BadShape for an image unlike those of the same ball that came before it.
        """
        if self.params.alone and SIDES[side] != self.params.alone:
            return None
        time += side * self.params.clock_offset
        spot = find_ball(image)
        reason = spot.reason
        seen = (image, spot) if reason is None else None
        leaving = reason is not None and reason.code is DetectionReason.NOT_WHOLE
        if time < self._last - WHOLE_AGAIN:
            self._renew()
            self._last = -np.inf
        if reason is None or leaving:
            if time < self._last - self.params.gap:
                self.counts.late += 1
                return None
            if time > self._last + self.params.gap:
                self._renew()
            kind = (*image.shape, str(image.dtype))
            if self._kinds[side] not in (None, kind):
                raise BadShape(f"image of {SIDES[side]} within a ball", kind, self._kinds[side])
            self._kinds[side] = kind
            self._last = max(self._last, time)
        mine, other = self._waiting[side], self._waiting[1 - side]
        if any(abs(time - at) <= self.params.pairing for at, _ in mine) or any(
            abs(time - at) <= self.params.pairing for at, *_ in self._pairs
        ):
            self.counts.duplicate += 1
            return None
        if self.params.alone:
            return self._pair(0, time, seen, seen, leaving)
        for entry in other:
            if abs(entry[0] - time) <= self.params.pairing:
                other.remove(entry)
                return self._pair(side, min(time, entry[0]), seen, entry[1], leaving)
        mine.append((time, seen))
        most = min(MOST_WAITING, max(1, MOST_BYTES // image.nbytes))
        for queue in self._waiting:
            while queue and (queue[0][0] < time - self.params.gap or len(queue) > most):
                self.counts.unpaired += queue.popleft()[1] is not None
        return None

    def _pair(self, side: int, time: float, seen: Seen, partner: Seen, leaving: bool) -> Burst | None:
        if seen is None or partner is None:
            self.counts.not_whole += leaving or seen is not partner
            enough = len(self._pairs) >= max(LEAST_FRAMES, self._used + 1) and all(time > at for at, *_ in self._pairs)
            return self._burst() if leaving and enough and self._wanted() else None
        if not self._wanted():
            self.counts.spare += 1
            return None
        self._pairs.append((time, seen, partner) if side == 0 else (time, partner, seen))
        return self._burst() if len(self._pairs) >= self._wanted() else None

    def _wanted(self) -> int:
        """Pairs in the next burst of this ball; 0: there is none."""
        return (self.params.frames, self.params.refined, 0)[self._given]

    def _burst(self) -> Burst:
        self._pairs.sort(key=lambda pair: pair[0])
        times, left, right = zip(*self._pairs, strict=True)
        self._given, self._used = self._given + 1, len(times)
        if not self._wanted():
            self._pairs, self._given = [], 2
        return Burst(
            np.array([image for image, _ in left]),
            np.array([image for image, _ in right]),
            np.array(times),
            [[spot for _, spot in side] for side in (left, right)],
            self._given == 2 and self.params.refined > 0 and self._used > self.params.frames,
        )

    def _renew(self) -> None:
        for queue in self._waiting:
            self.counts.unpaired += sum(seen is not None for _, seen in queue)
            queue.clear()
        self._pairs, self._given, self._used, self._kinds = [], 0, 0, [None, None]
