"""How far a long computation is: a bar in a terminal, a line for each tenth elsewhere. Both go to stderr."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

T = TypeVar("T")

COLUMNS = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()


@contextmanager
def progress(what: str, total: int, done: int = 0) -> Iterator[Callable[[int], None]]:
    """Show progress while the context lasts.

    Args:
        what: What is counted, e.g. "balls".
        total: How many there are.
        done: How many are done already.

    Yields:
        A function that is told how many more are done.
    """
    with Progress(*COLUMNS, console=Console(stderr=True), disable=not sys.stderr.isatty()) as bar:
        row = bar.add_task(what, total=total, completed=done)

        def advance(more: int) -> None:
            nonlocal done
            before, done = done, done + more
            bar.advance(row, more)
            if bar.disable and 10 * done // total > 10 * before // total:
                print(f"{done} of {total} {what}", file=sys.stderr, flush=True)

        yield advance


def tracked(what: str, total: int, items: Iterable[T]) -> Iterator[T]:
    """Yield the items, of which there are `total`, and show how many of them are done."""
    with progress(what, total) as advance:
        for item in items:
            yield item
            advance(1)
