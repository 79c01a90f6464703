"""Assembles the images of two cameras, which arrive one by one, to bursts.

A burst holds the images of one ball's passage through the high speed cameras (about six pairs). Images are paired by their stamps. Images
may be lost, arrive in any order, or arrive twice.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from tt_core.arrays import Image
from tt_core.errors import BadShape, check_range
from tt_core.params import check, param

from ..detection.ball_detection import DetectionReason, find_ball
from ..rig import SIDES
from .burst import LEAST_FRAMES, MOST_FRAMES, BallDetection, Burst

TIME_RESET = 1.0  # s; a stamp that is older than the newest one by more than this is taken as the start of another recording
MOST_WAITING_IMAGES = 64  # most images of a side that wait for their partners: more than a camera of 900 Hz sends in `gap`
MOST_WAITING_BYTES = 2**27  # most bytes of the images of a side that wait


@dataclass(frozen=True)
class BurstParams:
    """Parameters by which images are put together to bursts (the images of one ball's passage through the cameras)."""

    frames: int = param(6, "", "number of image pairs that make a burst; the dissertation uses 6", low=LEAST_FRAMES, high=MOST_FRAMES)
    refined: int = param(
        0,
        "",
        "number of image pairs of a second, longer burst of the same ball, more than `frames`; 0: no second burst",
        low=0,
        high=MOST_FRAMES,
    )
    alone: str = param("", "", "side of the camera to use if only one is used; empty: both are used", choices=("", *SIDES))
    clock_offset: float = param(0.0, "s", "time that is added to the stamps of the right camera", low=-10.0, high=10.0)
    gap: float = param(0.05, "s", "time without a ball after which the next ball is a new one", low=0.001, high=10.0)
    pairing: float = param(
        2e-4, "s", "largest difference of the stamps of two images of one pair; frames are 1.1e-3 s apart", low=0.0, high=0.1
    )

    def __post_init__(self) -> None:
        """Raise an error for a value outside its range."""
        check(self)
        if self.refined:
            check_range("refined", self.refined, self.frames + 1, MOST_FRAMES)


@dataclass
class AssemblerCounts:
    """Counts, since the start, of images and pairs of images that were not used in a burst, by the reason.

    Attributes:
        unpaired: Images of a whole ball for which no partner of the other camera came in time, or that were dropped as too many waited.
        duplicate: Images of the same camera and stamp as one before.
        late: Images that are older than the newest image of the present ball by more than `BurstParams.gap`.
        not_whole: Pairs of which at least one image does not show the whole ball.
        spare: Pairs that came when the bursts of their ball were complete.
    """

    unpaired: int = 0
    duplicate: int = 0
    late: int = 0
    not_whole: int = 0
    spare: int = 0


class Seen(NamedTuple):
    """An image that shows a whole ball, and where the ball is in it."""

    image: Image
    detection: BallDetection


class Waiting(NamedTuple):
    """An image that waits for its partner of the other camera: its time (s), and what it shows (None if it does not show a whole ball)."""

    time: float
    seen: Seen | None


class Views(NamedTuple):
    """One frame of a burst: its time (s), and for each camera that is used the image with its ball."""

    time: float
    seen: tuple[Seen, ...]


@dataclass
class Assembler:
    """Takes the images of both cameras one by one, in any order, and makes bursts of them.

    A burst holds the images of one ball's passage through the cameras. It is complete when it has `BurstParams.frames` pairs, or when its
    ball leaves the view after at least LEAST_FRAMES pairs. If `BurstParams.refined` is set, a second, longer burst of this ball follows.

    Attributes:
        params: Parameters by which images are put together.
        counts: Counts of images that were not used.
    """

    params: BurstParams = field(default_factory=BurstParams)
    counts: AssemblerCounts = field(default_factory=AssemblerCounts)
    _waiting: tuple[deque[Waiting], ...] = field(default_factory=lambda: (deque(), deque()))
    _pairs: list[Views] = field(default_factory=list)
    _kinds: list[tuple | None] = field(default_factory=lambda: [None, None])  # shape and type of the present ball's images
    _last: float = -np.inf  # newest stamp that showed a ball
    _given: int = 0  # number of bursts that were made of the present ball
    _used: int = 0  # number of pairs in the last of these bursts

    def add(self, side: int, time: float, image: Image) -> Burst | None:
        """Add one image.

        Args:
            side: Which camera, 0 left, 1 right.
            time: s, the middle of the exposure.
            image: (h, w) uint8 or uint16.

        Returns:
            The burst that is complete with this image; None if none is.

        Raises:
            TtError: The image is neither uint8 nor uint16.
            BadShape: The image differs in shape or type from earlier images of the same camera and ball, or is smaller than 8 x 8.
        """
        if self.params.alone and SIDES[side] != self.params.alone:
            return None
        time += side * self.params.clock_offset
        detection = find_ball(image)
        whole = detection.reason is None
        leaving = detection.reason is not None and detection.reason.code is DetectionReason.NOT_WHOLE
        if time < self._last - TIME_RESET:
            self._renew()
            self._last = -np.inf
        if whole or leaving:
            if time < self._last - self.params.gap:
                self.counts.late += 1
                return None
            self._follow(side, time, image)
        if self._is_known(side, time):
            self.counts.duplicate += 1
            return None
        seen = Seen(image, detection) if whole else None
        if self.params.alone:
            return self._add_views(time, (seen,), leaving)
        partner = self._take_partner(1 - side, time)
        if partner is not None:
            pair = (seen, partner.seen) if side == 0 else (partner.seen, seen)
            return self._add_views(min(time, partner.time), pair, leaving)
        self._waiting[side].append(Waiting(time, seen))
        self._drop_waiting(time, image.nbytes)
        return None

    @property
    def present(self) -> list[Views]:
        """The frames of the present ball that will be in its next burst, in the order in which they were completed; not a copy."""
        return self._pairs

    def _follow(self, side: int, time: float, image: Image) -> None:
        """Begin a new ball if the last one was seen more than `gap` ago; raise BadShape if the image is unlike earlier ones of its ball."""
        if time > self._last + self.params.gap:
            self._renew()
        kind = (*image.shape, str(image.dtype))
        if self._kinds[side] not in (None, kind):
            raise BadShape(f"image of {SIDES[side]} within a ball", kind, self._kinds[side])
        self._kinds[side] = kind
        self._last = max(self._last, time)

    def _is_known(self, side: int, time: float) -> bool:
        """Tell whether an image of this side and time has been added before and is still kept."""
        return any(abs(time - one.time) <= self.params.pairing for one in self._waiting[side]) or any(
            abs(time - one.time) <= self.params.pairing for one in self._pairs
        )

    def _take_partner(self, side: int, time: float) -> Waiting | None:
        """Remove the image of this side and time from those that wait, and return it; None if there is none."""
        for one in self._waiting[side]:
            if abs(one.time - time) <= self.params.pairing:
                self._waiting[side].remove(one)
                return one
        return None

    def _drop_waiting(self, time: float, image_bytes: int) -> None:
        """Drop images that have waited for too long, and the oldest ones where too many wait."""
        most = min(MOST_WAITING_IMAGES, max(1, MOST_WAITING_BYTES // image_bytes))
        for queue in self._waiting:
            while queue and (queue[0].time < time - self.params.gap or len(queue) > most):
                self.counts.unpaired += queue.popleft().seen is not None

    def _add_views(self, time: float, pair: tuple[Seen | None, ...], leaving: bool) -> Burst | None:
        """Add the images of one frame.

        Args:
            time: s.
            pair: For each camera that is used the image with its ball; None where no whole ball is in it.
            leaving: Whether the ball is partly out of view in the newest image.

        Returns:
            The burst that is complete with this frame or because its ball leaves the view; None if none is.
        """
        whole = tuple(seen for seen in pair if seen is not None)
        if len(whole) < len(pair):
            self.counts.not_whole += leaving or len(whole) > 0
            is_enough = len(self._pairs) >= max(LEAST_FRAMES, self._used + 1) and all(time > one.time for one in self._pairs)
            return self._burst() if leaving and is_enough and self._wanted() else None
        if not self._wanted():
            self.counts.spare += 1
            return None
        self._pairs.append(Views(time, whole))
        return self._burst() if len(self._pairs) >= self._wanted() else None

    def _wanted(self) -> int:
        """Return the number of pairs that the next burst of this ball needs; 0 if no further burst is to be made."""
        return (self.params.frames, self.params.refined, 0)[self._given]

    def _burst(self) -> Burst:
        """Make a burst of the frames that are kept."""
        pairs = sorted(self._pairs, key=lambda one: one.time)
        self._given, self._used = self._given + 1, len(pairs)
        if not self._wanted():
            self._pairs, self._given = [], 2
        by_camera = tuple(zip(*(one.seen for one in pairs), strict=True))
        return Burst(
            images=tuple(np.array([seen.image for seen in row]) for row in by_camera),
            times=np.array([one.time for one in pairs]),
            detections=tuple(tuple(seen.detection for seen in row) for row in by_camera),
            refined=self._given == 2 and self.params.refined > 0 and self._used > self.params.frames,
        )

    def _renew(self) -> None:
        """Forget the present ball and all images that are kept."""
        for queue in self._waiting:
            self.counts.unpaired += sum(one.seen is not None for one in queue)
            queue.clear()
        self._pairs, self._given, self._used, self._kinds = [], 0, 0, [None, None]
