"""Search for the best placement of an arm, on all cores: random placements, then changes of the best ones.

A search that was interrupted is resumed.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from tt_core.errors import TtError
from tt_core.robots import ArmFile

from ..process_pool import process_pool
from .placement import Placement, changed, draw_placement
from .quick_score import QuickScore, quick_score

DRAWN = 0.4  # share of the candidates that are drawn anew; the others are changes of the best ones
PARENTS = 8  # number of the best candidates that are changed
LARGEST_SEARCH_FILE = 20 * 1024 * 1024  # bytes of the file of a search


class OtherSearch(TtError):
    """The file for this search is that of another search."""

    def __init__(self, file: Path) -> None:
        """Store the file."""
        super().__init__(f"{file} is of the search of another arm, or no file of a search; remove it or name another folder")
        self.file = file


@dataclass(frozen=True)
class Candidate:
    """A placement of the arm and its score.

    Attributes:
        placement: Where the arm stands, how it holds the racket and where it waits.
        score: Its quick score.
    """

    placement: Placement
    score: QuickScore

    def value(self, weight: float) -> float:
        """Return the value that the search maximizes: the weighted mean of the shares for both kinds of balls.

        Args:
            weight: Weight of real play, 0 to 1.
        """
        return (1.0 - weight) * self.score.catapult + weight * self.score.rallies


@dataclass(frozen=True)
class SearchTask:
    """Parameters of a search.

    Attributes:
        urdf: Path of the URDF.
        arm: Its arm file, which has the first placement.
        kept: Parts of the placement that are not varied.
        weight: Weight of real play in the value of a candidate, 0 to 1.
        count: Number of candidates.
    """

    urdf: str
    arm: ArmFile
    kept: tuple[str, ...] = ()
    weight: float = 0.5
    count: int = 300


def front(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return the candidates for which no other one is better in both kinds of balls, by rising share for the catapult."""
    best, found = -1.0, list[Candidate]()
    for one in sorted(candidates, key=lambda c: (c.score.catapult, c.score.rallies), reverse=True):
        if one.score.rallies > best:
            best = one.score.rallies
            found.append(one)
    return found[::-1]


def scored_candidate(task: SearchTask, number: int, parent: Placement | None) -> Candidate:
    """Make one candidate and compute its score.

    Args:
        task: Parameters of the search.
        number: Number of the candidate, the seed of its random numbers. Number 0 is the placement of the arm file.
        parent: Placement that is changed; None to draw a new one.

    Raises:
        TtError: The arm itself cannot be used.
    """
    rng, start = np.random.default_rng(number), Placement.of(task.arm)
    try:
        if number == 0:
            made = start
        elif parent is None:
            made = draw_placement(start, task.urdf, task.arm, task.kept, rng)
        else:
            limits = start.model(task.urdf, task.arm).position_limits
            made = changed(parent, limits, task.kept, rng)
        if made.waiting is None and number:
            return Candidate(made, QuickScore(0.0, 0.0))
        return Candidate(made, quick_score(made.model(task.urdf, task.arm), task.arm))
    except TtError:
        if number == 0:  # the arm itself cannot be used
            raise
        return Candidate(made, QuickScore(0.0, 0.0))


def search_placements(
    task: SearchTask, file: Path, workers: int | None = None, report: Callable[[str], None] | None = None
) -> list[Candidate]:
    """Score `task.count` candidates. Those that are in the file already are not scored again.

    Args:
        task: Parameters of the search.
        file: JSON file with a line for each candidate, after a line that identifies the arm.
        workers: Number of processes; None: one for each core.
        report: Called with a line of progress now and then if there is no terminal for a bar.

    Returns:
        All candidates, those of the file first; the first one is the placement of the arm file.

    Raises:
        OtherSearch: The file is of another search.
        TtError: The arm cannot be used, or there are no shots of real play.
    """
    about = json.dumps({"urdf": task.urdf, "arm": asdict(task.arm), "kept": task.kept})
    done = _resumed(file, about)
    if not done:
        file.parent.mkdir(parents=True, exist_ok=True)
        first = scored_candidate(task, 0, None)
        file.write_text(f"{about}\n{_line(first)}\n")
        done.append(first)
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    workers = workers or os.cpu_count() or 1
    with (
        Progress(*columns, disable=not sys.stderr.isatty()) as bar,
        process_pool(workers) as pool,
        file.open("a") as record,
    ):
        row = bar.add_task("placements", total=task.count, completed=len(done))
        running: set[Future[Candidate]] = set()
        number = len(done)
        while number < task.count or running:
            while number < task.count and len(running) < 2 * workers:
                running.add(pool.submit(scored_candidate, task, number, _parent(task, done, number)))
                number += 1
            ended, running = wait(running, return_when=FIRST_COMPLETED)
            for future in ended:
                done.append(future.result())
                record.write(_line(done[-1]) + "\n")
                record.flush()
                bar.advance(row)
                if report is not None and bar.disable and len(done) % max(1, task.count // 10) == 0:
                    report(f"{len(done)} of {task.count} placements")
    return done


def _parent(task: SearchTask, done: Sequence[Candidate], number: int) -> Placement | None:
    """Return the placement that a candidate changes; None if a new one is to be drawn."""
    rng = np.random.default_rng([number, 1])
    if number < DRAWN * task.count and rng.uniform() < 0.8 and len(task.kept) < 2:
        return None
    best = sorted(done, key=lambda one: one.value(task.weight), reverse=True)[:PARENTS]
    better = [*best, *front(done)]
    return better[rng.integers(len(better))].placement


def _line(candidate: Candidate) -> str:
    return json.dumps(asdict(candidate))


def _resumed(file: Path, about: str) -> list[Candidate]:
    """Return the candidates of a file; none if there is no file."""
    if not file.exists():
        return []
    try:
        if file.stat().st_size > LARGEST_SEARCH_FILE:
            raise OtherSearch(file)
        first, *lines = file.read_text().splitlines()
        if first != about:
            raise OtherSearch(file)
        whole = [line for line in lines if line.endswith("}}")]  # an interruption may have cut the last one
        return [_candidate(json.loads(line)) for line in whole]
    except (OSError, ValueError, KeyError, TypeError) as error:
        if isinstance(error, OtherSearch):
            raise
        raise OtherSearch(file) from error


def _candidate(content: dict[str, dict[str, list[float] | None]]) -> Candidate:
    parts = {key: None if value is None else tuple(value) for key, value in content["placement"].items()}
    return Candidate(Placement(**parts), QuickScore(**content["score"]))  # type: ignore[arg-type]
