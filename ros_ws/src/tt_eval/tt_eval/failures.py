"""Reasons why a ball was not returned, one for each stage from the images to the return."""

from __future__ import annotations

from enum import Enum

from tt_core.failures import Failure


class EpisodeFailure(Enum):
    """Codes of `tt_core.failures.Failure`, one for each stage. Their values contain the failures of the stage itself."""

    NOT_SEEN = "not seen"  # no burst of images
    MEASUREMENT_REFUSED = "measurement refused: {cause}"
    NO_STROKE = "no stroke: {causes}"
    NO_SWING = "arm: {cause}"
    NOT_TRIED = "arm: no stroke was tried"  # the ball was over before they were there
    NOT_RETURNED = "{result}"  # the arm swung


class Causes(tuple[Failure, ...]):
    """Several failures of one stage. Its text contains each sentence once."""

    __slots__ = ()

    def __str__(self) -> str:
        """Return the sentences of the failures in alphabetical order, each once, separated by semicolons."""
        return "; ".join(sorted({str(failure) for failure in self}))
